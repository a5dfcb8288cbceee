"""Names find codecs, other packages can add some, and a wrong name is answered kindly."""

import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from drivers import registry
from drivers.codec import Codec, Decoder
from drivers.imu.kvh import KVH1750


def test_every_name_finds_its_codec() -> None:
    assert registry.names() == sorted(registry.CODECS)
    for codec in registry.all_codecs():
        assert isinstance(codec, Codec)
        assert registry.lookup(codec.name) is codec
        reader: Decoder = codec.decoder(codec.options())
        assert list(reader.feed(b"", 0)) == []
        assert list(reader.close()) == []


def test_unknown_name_offers_near_ones() -> None:
    with pytest.raises(registry.UnknownCodecError) as caught:
        registry.lookup("tracklink-ltx")
    assert caught.value.name == "tracklink-ltx"
    assert caught.value.known == registry.names()
    assert "did you mean tracklink-lxt" in str(caught.value)
    assert isinstance(caught.value, KeyError)


def test_name_like_none_lists_all() -> None:
    with pytest.raises(registry.UnknownCodecError) as caught:
        registry.lookup("?")
    assert str(caught.value).endswith(f"known: {', '.join(registry.names())}")


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package on the path whose metadata announces codecs, one of them under a built-in name."""
    (tmp_path / "other_sonar.py").write_text(
        "from dataclasses import replace\n"
        "from drivers.imu.kvh import KVH1750\n"
        "SONAR = replace(KVH1750, name='other-sonar')\n"
        "NOTHING = 1\n"
    )
    info = tmp_path / "other_sonar-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other-sonar\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[usblnav.codecs]\n"
        "other-sonar = other_sonar:SONAR\n"
        "kvh1750 = other_sonar:SONAR\n"
        "no-codec = other_sonar:NOTHING\n"
        "no-module = not_there:SONAR\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("other_sonar", None)


@pytest.mark.usefixtures("installed")
def test_other_packages_add_codecs_but_replace_none() -> None:
    assert registry.lookup("other-sonar").name == "other-sonar"
    assert "other-sonar" in registry.names()
    assert registry.lookup("kvh1750") is KVH1750


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("name", ["no-codec", "no-module"])
def test_broken_package_is_named(name: str) -> None:
    with pytest.raises(registry.CodecImportError, match=name):
        registry.lookup(name)


def test_group_is_the_documented_one() -> None:
    assert registry.GROUP == "usblnav.codecs"
    assert isinstance(EntryPoints([EntryPoint("a", "b:c", registry.GROUP)]), EntryPoints)
