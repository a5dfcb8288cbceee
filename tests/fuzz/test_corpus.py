"""What hunts found worth keeping holds today, and the oracle finds what decoders do wrong."""

import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import nan

import pytest

from drivers import registry
from drivers.codec import Decoder, NoOptions
from drivers.framing import LineDecoder
from drivers.imu.sample import Preference
from drivers.nmea0183 import NMEA0183
from drivers.records import DepthRecord, Record, Rejected
from tests.drivers.streams import FRAMES
from tests.fuzz import corpus
from tests.fuzz.__main__ import main
from tests.fuzz.sealing import sealed
from tests.fuzz.seeds import words
from tests.fuzz.trial import Trial, check, check_flood, trial_of
from tests.shared_data import ROOT

EVERY = pytest.mark.parametrize("codec", sorted(registry.CODECS))


@EVERY
def test_kept_inputs(codec: str) -> None:
    inputs = corpus.read(codec)
    assert inputs
    for data in inputs:
        check(codec, data)
    check_flood(codec, max(inputs, key=len))


def test_the_corpus_is_small_text() -> None:
    files = sorted(corpus.FOLDER.iterdir())
    assert [path.name for path in files] == sorted(f"{codec}.txt" for codec in registry.CODECS)
    assert sum(path.stat().st_size for path in files) < 300_000
    assert all(path.read_bytes().isascii() for path in files)


def test_lines_of_the_corpus_are_its_inputs() -> None:
    data = trial_of(bytes(range(256)) + b" \\n ", options=513, cut=7)
    assert corpus.parse(corpus.line(data)) == data


def test_any_bytes_are_a_trial() -> None:
    assert Trial.of("mip", b"").chunks == []
    assert Trial.of("mip", trial_of(b"abc", cut=0)).chunks == [b"a", b"b", b"c"]
    assert Trial.of("mip", trial_of(b"abc", cut=1)).chunks == [b"abc"]
    assert b"".join(Trial.of("mip", trial_of(bytes(500), cut=9)).chunks) == bytes(500)
    options = [Trial.of("mip", trial_of(b"", options=n)).options for n in range(3)]
    assert options == [Preference(prefer=p) for p in ("increments", "rates", "increments")]


@EVERY
def test_sealing_leaves_good_frames_and_mends_bad_ones(codec: str) -> None:
    stream = b"".join(FRAMES[codec])
    assert sealed(codec, stream) == stream
    assert words(codec)
    checked = b"$GPHDT,1.0,T*00\r\n"
    assert sealed(codec, checked) != checked or codec == "evologics"


def test_the_command_tries_what_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sbg-ecom", "--minutes", "0"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].split()[0::5] == ["sbg-ecom", "none"]


def test_the_command_needs_no_tools_of_tests() -> None:
    """What `pip install .[fuzz]` brings is enough; atheris itself is asked for by name."""
    without = "import sys; sys.modules.update(pytest=None, hypothesis=None)"
    told = f"{without}; from tests.fuzz.__main__ import main; main(['anpp', '--minutes', '0'])"
    done = subprocess.run(
        [sys.executable, "-c", told], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "anpp" in done.stdout


class Hoarder:
    """Takes everything, gives nothing before the end."""

    def __init__(self) -> None:
        self._held: list[bytes] = []

    def feed(self, data: bytes, t_rx_ns: int) -> Iterable[Record | Rejected]:
        self._held.append(data)
        return []

    def close(self) -> Iterable[Record | Rejected]:
        data = b"".join(self._held)
        return [Rejected(t_rx_ns=0, line_bytes=len(self._held[0]), reason="unknown", data=data)]


class Chunky:
    """One record a chunk."""

    def feed(self, data: bytes, t_rx_ns: int) -> Iterable[Record | Rejected]:
        return [Rejected(t_rx_ns=t_rx_ns, line_bytes=len(data), reason="unknown", data=data)]

    def close(self) -> Iterable[Record | Rejected]:
        return []


def lossy() -> Decoder:
    """Forgets the first byte."""
    whole = NMEA0183.decoder(NMEA0183.options())

    class Lossy:
        def feed(self, data: bytes, t_rx_ns: int) -> Iterable[Record | Rejected]:
            return whole.feed(data[1:], t_rx_ns)

        def close(self) -> Iterable[Record | Rejected]:
            return whole.close()

    return Lossy()


def nobody_knows() -> Decoder:
    """Says what is no number."""

    def decode(_line: str, t_rx_ns: int, line_bytes: int) -> Record:
        return DepthRecord(t_rx_ns=t_rx_ns, line_bytes=line_bytes, depth_m=nan)

    return LineDecoder(decode, lambda _line: (0,))


class Loud:
    """Raises."""

    def feed(self, data: bytes, t_rx_ns: int) -> Iterable[Record | Rejected]:
        raise IndexError(data[:1])

    def close(self) -> Iterable[Record | Rejected]:
        return []


@pytest.mark.parametrize(
    ("made", "how", "cut", "fault"),
    [
        (Loud, check, 1, IndexError),
        (Chunky, check, 0, AssertionError),
        (lossy, check, 1, AssertionError),
        (nobody_knows, check, 1, AssertionError),
        (Hoarder, check_flood, 1, AssertionError),
    ],
)
def test_the_oracle_finds(
    made: Callable[[], Decoder],
    how: Callable[[str, bytes], None],
    cut: int,
    fault: type[Exception],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    codec = replace(NMEA0183, options=NoOptions, decoder=lambda _options: made())
    monkeypatch.setitem(globals(), "BROKEN", codec)
    monkeypatch.setitem(registry.CODECS, "broken", f"{__name__}:BROKEN")
    with pytest.raises(fault):
        how("broken", trial_of(b"a line\r\n", cut=cut))
