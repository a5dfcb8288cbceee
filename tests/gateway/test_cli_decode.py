"""`usblnav decode` as a user meets it: files, pipes, hexadecimal text, options."""

import json
import re
import signal
import subprocess
from pathlib import Path

import pytest

from drivers.hosttime import now_ns
from tests.gateway.command_line import FRAMES, USBLNAV, lines, records, usblnav
from tests.shared_data import ROOT


@pytest.fixture
def cable(tmp_path: Path) -> Path:
    path = tmp_path / "cable.bin"
    path.write_bytes(b"".join(FRAMES))
    return path


def test_decode_prints_one_object_a_record(cable: Path) -> None:
    done = usblnav("decode", "--codec", "kvh1750", cable)
    assert done.returncode == 0
    assert lines(done.stderr) == ["3 imu"]
    decoded = records(done.stdout)
    assert [(r["record"], r["sequence"], r["t_rx_ns"]) for r in decoded] == [
        ("imu", 0, 0),
        ("imu", 1, 0),
        ("imu", 2, 0),
    ]
    assert decoded[0]["delta_angle_rad"] == pytest.approx([0.001, 0.0, 0.0], rel=1e-6)


def test_decode_counts_what_it_rejects(tmp_path: Path) -> None:
    junk, broken = b"junk", FRAMES[1][:-1] + bytes([FRAMES[1][-1] ^ 1])
    path = tmp_path / "cable.bin"
    path.write_bytes(FRAMES[0] + junk + broken + FRAMES[2] + FRAMES[0][:7])
    done = usblnav("decode", "--codec", "kvh1750", path)
    assert done.returncode == 0
    decoded = records(done.stdout)
    assert [r["sequence"] for r in decoded if r["record"] == "imu"] == [0, 2]
    lost = [bytes.fromhex(str(r["bytes"])) for r in decoded if r["record"] == "rejected"]
    assert b"".join(lost) == junk + broken + FRAMES[0][:7]
    assert lines(done.stderr)[0].startswith("2 imu, ")
    assert sum(int(n) for n in re.findall(r"(\d+) rejected", done.stderr.decode())) == len(lost)


def test_decode_takes_the_options_of_the_codec(cable: Path) -> None:
    options = ["-o", "gyro=rate_deg_s", "-o", "accel=delta_v_m_s"]
    first = records(usblnav("decode", "--codec", "kvh1750", *options, cable).stdout)[0]
    assert first["rate_rad_s"] == pytest.approx([0.001 * 3.141592653589793 / 180, 0, 0], rel=1e-6)
    assert first["delta_velocity_m_s"] == pytest.approx([0.0, 0.0, -1.0], rel=1e-6)


def test_decode_names_every_wrong_option(cable: Path) -> None:
    options = ["-o", "gyro=rpm", "-o", "accl=g", "-o", "x", "-o", "gyro=rad"]
    done = usblnav("decode", "--codec", "kvh1750", *options, cable)
    assert done.returncode == 2
    assert lines(done.stderr) == [
        "usblnav: -o x: expected key=value",
        "usblnav: -o gyro: given twice",
        "usblnav: -o gyro: expected one of delta_angle_deg, delta_angle_rad, rate_deg_s, "
        'rate_rad_s, got "rpm"',
        "usblnav: -o accl: unknown key; did you mean accel?",
    ]


def test_decode_option_of_text_needs_no_quotes() -> None:
    done = usblnav("decode", "--codec", "tracklink-gll", "-o", "beacon=7", "-")
    assert (done.returncode, lines(done.stderr)) == (0, ["no records"])


def test_decode_reads_hexadecimal_text() -> None:
    digits = b"".join(FRAMES).hex()
    text = "\n".join(f"{digits[n : n + 5]} \t" for n in range(0, len(digits), 5))
    done = usblnav("decode", "--codec", "kvh1750", "--hex", "-", data=text.upper().encode())
    assert [r["sequence"] for r in records(done.stdout)] == [0, 1, 2]


@pytest.mark.parametrize(
    ("text", "whole", "said"),
    [
        (b"fe 81\nxy\n", b"\xfe\x81", "line 2: not hexadecimal"),
        (b"fe 8\x31\n\xff", b"\xfe\x81", "line 2: not hexadecimal"),
        (b"fe 8\n", b"\xfe", "ends in half a byte"),
    ],
)
def test_decode_says_where_the_hexadecimal_ends(text: bytes, whole: bytes, said: str) -> None:
    done = usblnav("decode", "--codec", "kvh1750", "--hex", "-", data=text)
    assert done.returncode == 1
    assert lines(done.stderr)[-1] == f"usblnav: standard input: {said}"
    assert b"".join(bytes.fromhex(str(r["bytes"])) for r in records(done.stdout)) == whole


def test_decode_follows_a_live_cable_until_interrupted() -> None:
    before = now_ns()
    with subprocess.Popen(
        [*USBLNAV, "decode", "--codec", "kvh1750", "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
    ) as process:
        assert process.stdin and process.stdout and process.stderr
        for sequence, frame in enumerate(FRAMES):
            process.stdin.write(frame)
            process.stdin.flush()
            record = json.loads(process.stdout.readline())
            assert record["sequence"] == sequence
            assert before < record["t_rx_ns"] < now_ns()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        assert lines(process.stderr.read()) == ["3 imu"]
