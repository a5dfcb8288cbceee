"""Recordings as commands name them, and what they say of damaged ones."""

import json
from pathlib import Path

import pytest

from gateway import cli
from gateway.recording.writer import Tape
from tests.gateway.recorded import batches, files, nav, orders, raw, utc


def record(folder: Path, run: str = "run") -> Path:
    """A closed recording of bytes and solutions; give its file."""
    folder.mkdir(exist_ok=True)
    writer = Tape(orders(folder, run))
    for batch in batches([utc(), *(raw(n) for n in range(29)), *(nav(200 * n) for n in range(20))]):
        writer.take(batch)
        writer.flush()
    writer.close()
    return files(folder)[-1]


def hit(path: Path) -> None:
    """Turn bits of the third chunk."""
    data = bytearray(path.read_bytes())
    at = -1
    for _ in range(3):
        at = data.index(b"\x04\x00\x00\x00zstd", at + 1)
    data[at + 50] ^= 0x55
    path.write_bytes(data)


@pytest.mark.parametrize("command", ["export", "replay"])
def test_a_folder_is_the_files_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    tapes = tmp_path / "tapes"
    path = record(tapes)
    made = []
    for n, name in enumerate((tapes, path)):
        out = tmp_path / f"out-{n}"
        assert cli.main([command, str(name), "-o", str(out)]) == 0
        made.append((out / "nav.csv").read_bytes())
    assert made[0] == made[1]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("command", ["export", "replay"])
def test_damage_is_said_once_and_passed_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    path = record(tmp_path / "tapes")
    hit(path)
    out = tmp_path / "out"
    assert cli.main([command, str(path.parent), "-o", str(out)]) == 0
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert line.startswith(f"usblnav: {path}: damaged at byte ")
    assert line.endswith(" bytes, 10 events lost")
    told = json.loads((out / "summary.json").read_text())["recording"]
    assert (told["missing"], [damage["events"] for damage in told["damaged"]]) == (10, [10])
    assert "damaged: 1\n" in said.out


@pytest.mark.parametrize("command", ["export", "replay"])
def test_what_is_no_recording_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    missing = tmp_path / "missing"
    assert cli.main([command, str(empty), str(missing), "-o", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.splitlines() == [
        f"usblnav: {empty}: a folder without a recording (*.mcap)",
        f"usblnav: {missing}: no such file or folder",
    ]


@pytest.mark.parametrize("command", ["export", "replay", "report"])
def test_of_a_folder_with_two_runs_the_files_of_each_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    tapes = tmp_path / "tapes"
    names = [record(tapes, run).name for run in ("a", "a", "b")]
    assert cli.main([command, str(tapes), "-o", str(tmp_path / "out")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"name the files of one: {names[0]} to {names[1]}; {names[2]}")


@pytest.mark.parametrize("left", [b"", b"\x89MCAP0\r\n", bytes(4096)])
def test_a_file_without_a_beginning_costs_itself_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], left: bytes
) -> None:
    """As a power failure leaves the newest."""
    tapes = tmp_path / "tapes"
    whole = record(tapes)
    lost = whole.with_name(whole.name.replace("000001", "000002"))
    lost.write_bytes(left)
    assert cli.main(["export", str(tapes), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert said.err == (f"usblnav: {lost}: damaged at byte 0: {len(left)} bytes, its events lost\n")
    told = json.loads((tmp_path / "out" / "summary.json").read_text())["recording"]
    assert (told["files"], told["missing"], told["events"]) == (2, 0, 50)
    assert cli.main(["replay", str(lost), "-o", str(tmp_path / "again")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
