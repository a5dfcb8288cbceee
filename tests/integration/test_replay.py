"""The replay command: deterministic, accurate, one line for whatever is wrong with its files."""

import gzip
import json
import os
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from gateway import replay
from gateway.config import load
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.replay import pipeline
from tests.gateway.emulated import START, make
from tests.integration.rig import USBLNAV, brisk
from tests.integration.scores import errors, read
from tests.shared_data import ROOT

TABLES = ["nav.csv", "innovations.csv", "calibration.csv"]
DURATION_S = 40.0


@dataclass(frozen=True)
class Voyage:
    """A short capture with its truth, its configuration and its replay."""

    capture: Path
    truth: Path
    config: Path
    out: Path


@pytest.fixture(scope="module")
def voyage(tmp_path_factory: pytest.TempPathFactory) -> Voyage:
    folder = tmp_path_factory.mktemp("voyage")
    data = brisk(folder) | {"duration_s": DURATION_S, "start": START}
    scenario = twin.for_capture(make(data))
    whole = Voyage(
        folder / "short.pcap", folder / "truth.csv", folder / "config.yaml", folder / "out"
    )
    emulate(scenario, pcap=whole.capture, truth=whole.truth, say=lambda _line: None)
    whole.config.write_text(yaml.safe_dump(twin.gateway_config(scenario)))
    done = run(whole, whole.out, whole.capture)
    assert done.returncode == 0, done.stderr
    return whole


def run(
    voyage: Voyage, out: Path, *captures: Path, **environment: str
) -> "subprocess.CompletedProcess[str]":
    done = subprocess.run(
        [*USBLNAV, "replay", *captures, "-c", voyage.config, "-o", out, "--json"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | environment,
        timeout=60,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done


def one_line(done: "subprocess.CompletedProcess[str]") -> str:
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    return line


def test_it_is_accurate(voyage: Voyage) -> None:
    rms = errors(voyage.out / "nav.csv", voyage.truth).rms(START + 20.0)
    assert rms["horizontal"] < 0.6
    assert rms["vertical"] < 0.4
    assert rms["heading"] < 0.3


def test_solutions_come_at_the_rate_asked_for(voyage: Voyage) -> None:
    t = read(voyage.out / "nav.csv")["t_s"] - START
    assert len(t) == pytest.approx(DURATION_S * 10, abs=2)
    assert np.abs(np.diff(t)[1:] - 0.1).max() < 0.0051  # the first sample of each period


def test_the_same_input_gives_the_same_bytes(voyage: Voyage, tmp_path: Path) -> None:
    packed = tmp_path / "short.pcap.gz"
    packed.write_bytes(gzip.compress(voyage.capture.read_bytes()))
    assert run(voyage, tmp_path, packed, PYTHONHASHSEED="7").returncode == 0
    for name in TABLES:
        assert (tmp_path / name).read_bytes() == (voyage.out / name).read_bytes()


@pytest.mark.parametrize("chunks", [1, 7])
def test_it_does_not_matter_how_samples_are_gathered(
    voyage: Voyage, tmp_path: Path, chunks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "CHUNKS_PER_BLOCK", chunks)
    replay.run([voyage.capture], load(voyage.config), out=tmp_path, rate_hz=10.0)
    for name in TABLES:
        assert (tmp_path / name).read_bytes() == (voyage.out / name).read_bytes()


def test_captures_in_parts_are_merged_by_time(voyage: Voyage, tmp_path: Path) -> None:
    packets = split(voyage.capture.read_bytes())
    header = packets[0]
    for k in range(2):
        part = [p for n, p in enumerate(packets[1:]) if (n % 5 == 0) == (k == 0)]
        (tmp_path / f"{k}.pcap").write_bytes(header + b"".join(part))
    out = tmp_path / "out"
    assert run(voyage, out, tmp_path / "1.pcap", tmp_path / "0.pcap").returncode == 0
    assert (out / "nav.csv").read_bytes() == (voyage.out / "nav.csv").read_bytes()


def split(capture: bytes) -> list[bytes]:
    """File header and packets, each with its own."""
    parts, at = [capture[:24]], 24
    while at < len(capture):
        (size,) = struct.unpack_from("<I", capture, at + 8)
        parts.append(capture[at : at + 16 + size])
        at += 16 + size
    return parts


def test_the_summary_accounts_for_everything(voyage: Voyage, tmp_path: Path) -> None:
    done = run(voyage, tmp_path, voyage.capture)
    summary = json.loads(done.stdout)
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    packets = split(voyage.capture.read_bytes())[1:]
    assert summary["capture"]["packets"] == summary["capture"]["selected"] == len(packets)
    imu, usbl = summary["devices"]["imu0"], summary["devices"]["usbl0"]
    assert imu["records"] + usbl["records"] == len(packets)
    assert imu["bytes"] + usbl["bytes"] == sum(len(packet) - 16 - 42 for packet in packets)
    verdicts = summary["filter"]
    assert verdicts["imu_samples"] == imu["measurements"] == imu["records"]
    assert verdicts["fixes_used"] + verdicts["gated"] == usbl["measurements"] > 70
    rows = (tmp_path / "innovations.csv").read_text().splitlines()[1:]
    fixes = {tuple(row.split(",")[:3]) for row in rows}
    assert len(fixes) == usbl["measurements"]
    assert summary["duration_s"] == pytest.approx(DURATION_S, abs=0.1)
    assert summary["real_time_factor"] > 0.0  # how fast: python -m tests.bench


@pytest.mark.parametrize("packed", [False, True])
def test_of_a_capture_cut_off_all_that_came_before_is_written(
    voyage: Voyage, tmp_path: Path, packed: bool
) -> None:
    whole = voyage.capture.read_bytes()
    cut = tmp_path / "cut.pcap"
    cut.write_bytes((gzip.compress(whole) if packed else whole)[: len(whole) * 2 // 5])
    line = one_line(run(voyage, tmp_path, cut))
    assert line.startswith(f"usblnav: {cut}: cut off at byte ")
    good = int(line.split()[-3])
    seconds, fraction = struct.unpack_from("<II", split(whole)[good])
    nav = (tmp_path / "nav.csv").read_text()
    assert (voyage.out / "nav.csv").read_text().startswith(nav)
    last = float(nav.splitlines()[-1].split(",")[0])
    assert seconds + fraction * 1e-9 - last < 0.1 + 0.01
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["capture"]["packets"] == good


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "empty file"),
        (b"A text, not a capture.\n", "neither pcap nor pcapng"),
        (gzip.compress(b"A text, not a capture.\n", mtime=0), "neither pcap nor pcapng"),
    ],
    ids=["empty", "text", "packed text"],
)
def test_what_is_no_capture_is_one_line(
    voyage: Voyage, tmp_path: Path, content: bytes, said: str
) -> None:
    path = tmp_path / "capture"
    path.write_bytes(content)
    assert one_line(run(voyage, tmp_path / "out", path)) == f"usblnav: {path}: {said}"


def test_a_capture_of_something_else_is_one_line(voyage: Voyage, tmp_path: Path) -> None:
    config = yaml.safe_load(voyage.config.read_text())
    for n, device in enumerate(config["devices"].values()):
        device["link"] = {"type": "udp", "port": 9 + n}
    other = Voyage(voyage.capture, voyage.truth, tmp_path / "config.yaml", tmp_path)
    other.config.write_text(yaml.safe_dump(config))
    packets = len(split(voyage.capture.read_bytes())) - 1
    assert one_line(run(other, tmp_path / "out", voyage.capture)) == (
        f"usblnav: {voyage.capture}: no packet for any device of the configuration"
        f" ({packets} packets read)"
    )


@pytest.mark.parametrize("name", [*TABLES, "summary.json"])
def test_a_full_disk_is_one_line(voyage: Voyage, tmp_path: Path, name: str) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    (tmp_path / name).symlink_to("/dev/full")
    line = one_line(run(voyage, tmp_path, voyage.capture))
    assert line == f"usblnav: {tmp_path / name}: cannot write: No space left on device"


def test_a_file_in_the_place_of_the_folder_is_one_line(voyage: Voyage, tmp_path: Path) -> None:
    line = one_line(run(voyage, voyage.config, voyage.capture))
    assert line == f"usblnav: {voyage.config}: cannot write: File exists"
