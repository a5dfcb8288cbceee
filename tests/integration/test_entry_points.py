"""Another package's codecs, installed for real: found, usable, harmless if broken."""

import json
import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from tests.shared_data import ROOT

MODULES = {
    "other_sonar/__init__.py": "",
    "other_sonar/good.py": """
from dataclasses import replace
from drivers.usbl.sonardyne import PSONLLD
SONAR = replace(PSONLLD, name="other-sonar", devices="Other Sonar 1")
TWIN = replace(PSONLLD, name="somebody-else")
NOTHING = 1
""",
    "other_sonar/broken.py": "import a_library_that_is_not_there",
    "other_sonar/wild.py": "raise ZeroDivisionError('in\\ntwo lines')",
    "other_sonar/unreadable.py": "def (",
}
ENTRY_POINTS = """[usblnav.codecs]
other-sonar = other_sonar.good:SONAR
kvh1750 = other_sonar.good:SONAR
x-absent = other_sonar.absent:SONAR
x-broken = other_sonar.broken:SONAR
x-misnamed = other_sonar.good:TWIN
x-nothing = other_sonar.good:NOTHING
x-unreadable = other_sonar.unreadable:SONAR
x-wild = other_sonar.wild:SONAR
"""


def wheel(folder: Path, name: str, modules: dict[str, str], entry_points: str) -> Path:
    """A wheel as any build tool makes it."""
    info = f"{name}-1.0.dist-info"
    files = {
        **modules,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/entry_points.txt": entry_points,
    }
    path = folder / f"{name}-1.0-py3-none-any.whl"
    with ZipFile(path, "w") as file:
        for place, text in files.items():
            file.writestr(place, text)
        file.writestr(f"{info}/RECORD", "".join(f"{place},,\n" for place in files))
    return path


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two packages, installed by pip; the second announces a name of the first."""
    folder = tmp_path_factory.mktemp("wheels")
    site = folder / "site"
    second = "[usblnav.codecs]\nother-sonar = other_sonar.good:TWIN\n"
    wheels = [
        wheel(folder, "other_sonar", MODULES, ENTRY_POINTS),
        wheel(folder, "second_sonar", {}, second),
    ]
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    target = ["--no-deps", "--no-index", "--target", str(site)]
    subprocess.run([*pip, *target, *map(str, wheels)], check=True, timeout=60)
    return site


def usblnav(site: Path, *arguments: str | Path, data: bytes = b"") -> tuple[int, str, list[str]]:
    """Exit code, standard output, lines of standard error."""
    done = subprocess.run(
        [sys.executable, "-m", "gateway", *arguments],
        input=data,
        capture_output=True,
        check=False,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": f"{ROOT}:{site}"},
        timeout=60,
    )
    return done.returncode, done.stdout.decode(), done.stderr.decode().splitlines()


def test_codecs_lists_the_good_and_names_the_broken(site: Path) -> None:
    code, out, err = usblnav(site, "codecs", "--json")
    listed = {entry["name"]: entry for entry in json.loads(out)}
    assert code == 0
    assert listed["other-sonar"]["devices"] == "Other Sonar 1"
    assert listed["kvh1750"]["kind"] == "imu"
    assert not any(name.startswith("x-") for name in listed)
    of = "of other_sonar 1.0"
    assert err == [
        f'usblnav: codec "kvh1750" (other_sonar.good:SONAR {of}): the name is taken',
        'usblnav: codec "other-sonar" (other_sonar.good:TWIN of second_sonar 1.0): '
        "the name is taken",
        f'usblnav: codec "x-absent" (other_sonar.absent:SONAR {of}): '
        "ModuleNotFoundError: No module named 'other_sonar.absent'",
        f'usblnav: codec "x-broken" (other_sonar.broken:SONAR {of}): '
        "ModuleNotFoundError: No module named 'a_library_that_is_not_there'",
        f'usblnav: codec "x-misnamed" (other_sonar.good:TWIN {of}) calls itself "somebody-else"',
        f'usblnav: codec "x-nothing" (other_sonar.good:NOTHING {of}) is not a drivers.codec.Codec',
        f'usblnav: codec "x-unreadable" (other_sonar.unreadable:SONAR {of}): '
        "SyntaxError: invalid syntax (unreadable.py, line 1)",
        f'usblnav: codec "x-wild" (other_sonar.wild:SONAR {of}): ZeroDivisionError: in',
    ]


def test_it_decodes(site: Path) -> None:
    line = (
        b"$PSONLLD,133707.59,Ship 1,A,51.3306281,-0.83499295,0.000,0.08,0.08,0.00,0.01,,,,*1D\r\n"
    )
    code, out, err = usblnav(site, "decode", "--codec", "other-sonar", "-", data=line)
    assert (code, err) == (0, ["1 usbl"])
    assert json.loads(out)["beacon"] == "Ship 1"


@pytest.mark.parametrize(
    ("codec", "said"),
    [
        ("other-sonar", None),
        ("x-broken", "ModuleNotFoundError: No module named 'a_library_that_is_not_there'"),
        ("kvh1750", "kvh1750 is of kind imu, the device of kind usbl; one of: evologics, "),
    ],
)
def test_it_stands_in_a_configuration(
    site: Path, tmp_path: Path, codec: str, said: str | None
) -> None:
    path = tmp_path / "config.yaml"
    example = (ROOT / "config.yaml").read_text()
    path.write_text(example.replace("codec: tracklink-lxt", f"codec: {codec}"))
    code, _, err = usblnav(site, "check", path)
    if said is None:
        assert code == 0
    else:
        (line,) = err
        assert (code, "devices.usbl0.codec: " in line, said in line) == (2, True, True)
