"""Foxglove's own libraries on a recording: each topic by its schema, the track for its map."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from gateway.recording.reader import RecordedRun
from tests.integration.rig import Rig
from tests.shared_data import ROOT

SCRIPT = ROOT / "tests" / "integration" / "foxglove.cjs"
pytestmark = [
    pytest.mark.live,
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("node") and os.environ.get("NODE_PATH")),
        reason="no node, or no NODE_PATH with Foxglove's libraries (docs/recording.md)",
    ),
]


def read(recording: Path) -> dict[str, Any]:
    """What the libraries make of a file."""
    done = subprocess.run(
        ["node", SCRIPT, recording], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


async def test_foxglove_reads_every_topic_and_shows_the_track(tmp_path: Path) -> None:
    rig, tapes = Rig(tmp_path), tmp_path / "tapes"
    tapes.mkdir()
    rig.write({"recording": {"folder": str(tapes)}})
    async with rig.gateway(), rig.emulator():
        rig.hear_zenoh()
        await rig.until("fixes", lambda: rig.navs and rig.navs[-1].fixes_used >= 5)
        await rig.until("a true position", rig.is_right)
        heard = list(rig.navs)
    (tape,) = tapes.glob("*.mcap")
    topics = read(tape)["topics"]
    kinds = {"/raw/imu0", "/raw/usbl0", "/records/imu0/imu", "/records/usbl0/usbl"}
    assert set(topics) >= kinds | {"/nav", "/innovation", "/calibration", "/status", "/location"}
    for name, topic in topics.items():
        assert topic["messages"] > 0, name
        assert topic["strangers"] == [], name
        # Of a mapping only the keys of its first message are fields to plot.
        told = [path for path in topic["wrong"] if ".senders." not in path]
        told = [path for path in told if ".ignored." not in path and ".rejected." not in path]
        assert told == [], name
    assert [name for name, topic in topics.items() if topic["shown"]] == ["/location"]
    place = topics["/location"]["last"]
    near = min(heard, key=lambda nav: abs(nav.utc_ns * 1e-9 - place["timestamp"]["sec"]))
    assert (place["latitude"], place["longitude"]) == pytest.approx(
        (near.lat_deg, near.lon_deg), abs=1e-3
    )
    events = list(RecordedRun([tape]).events())
    raws = topics["/raw/imu0"]["messages"] + topics["/raw/usbl0"]["messages"]
    assert raws == sum(type(event).__name__ == "Raw" for event in events)
