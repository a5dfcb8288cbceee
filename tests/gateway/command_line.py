"""The command as a process, and frames of an IMU to feed it."""

import json
import subprocess
import sys
from pathlib import Path

from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.records import ImuRecord
from tests.shared_data import ROOT

USBLNAV = [sys.executable, "-m", "gateway"]
FRAMES = [
    KVH1750.encode(
        ImuRecord(
            t_rx_ns=0,
            sequence=n,
            delta_angle_rad=(0.001, 0.0, 0.0),
            specific_force_m_s2=(0.0, 0.0, -9.80665),
            temperature_c=20.0,
        ),
        KvhOptions(),
    )
    for n in range(3)
]


def usblnav(*arguments: str | Path, data: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    done = subprocess.run(
        [*USBLNAV, *arguments], input=data, capture_output=True, cwd=ROOT, timeout=60, check=False
    )
    assert b"Traceback" not in done.stderr, done.stderr.decode()
    return done


def lines(output: bytes) -> list[str]:
    return output.decode().splitlines()


def records(output: bytes) -> list[dict[str, object]]:
    return [json.loads(line) for line in lines(output)]
