"""Qt's reader of NMEA 0183, which is QGroundControl's, on a gateway's TCP.

QGroundControl takes a place only with a horizontal accuracy of 100 m or better and a height only
with a vertical one of 10 m or better (its ``PositionManager.cc``), and Qt makes both of dilutions
alone. Needs PyQt6: ``pip install PyQt6``, then ``pytest -m slow tests/integration/test_qt.py``.
"""

import asyncio
import json
import math
import socket
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.integration.rig import Rig, brisk
from tests.loopback import free_port

pytest.importorskip("PyQt6.QtPositioning", reason="no PyQt6 (docs/outputs.md)")
pytestmark = [pytest.mark.live, pytest.mark.slow]

RANGE_ERROR_M = 5.1
"""What QGroundControl has Qt multiply dilutions by."""
READER = """
import json, sys
from PyQt6.QtCore import QCoreApplication
from PyQt6.QtNetwork import QTcpSocket
from PyQt6.QtPositioning import QGeoPositionInfo, QNmeaPositionInfoSource

application = QCoreApplication([])
line = QTcpSocket()
line.connectToHost("127.0.0.1", int(sys.argv[1]))
assert line.waitForConnected(10_000)
source = QNmeaPositionInfoSource(QNmeaPositionInfoSource.UpdateMode.RealTimeMode)
source.setDevice(line)
source.setUserEquivalentRangeError(float(sys.argv[2]))

def told(info):
    place = info.coordinate()
    said = {a.name: info.attribute(a) for a in QGeoPositionInfo.Attribute if info.hasAttribute(a)}
    said |= {"lat": place.latitude(), "lon": place.longitude(), "height": place.altitude()}
    print(json.dumps(said | {"time": info.timestamp().toMSecsSinceEpoch()}), flush=True)

source.positionUpdated.connect(told)
source.startUpdates()
application.exec()
"""


@pytest.mark.parametrize("range_error_m", [RANGE_ERROR_M, None])
async def test_qgroundcontrols_reader_has_place_and_accuracy(
    range_error_m: float | None, tmp_path: Path
) -> None:
    rig, port = Rig(tmp_path, brisk(tmp_path)), free_port(socket.SOCK_STREAM)
    output: dict[str, Any] = {"type": "nmea", "link": {"type": "tcp", "port": port}}
    output |= {"sentences": ["GGA", "GSA", "RMC", "VTG"], "range_error_m": range_error_m}
    rig.write({"outputs": [*rig.config["outputs"], output]})
    async with rig.gateway(), rig.emulator():
        rig.hear_zenoh()
        await rig.until("a true position", rig.is_right)
        reader = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", READER, str(port), str(RANGE_ERROR_M)),
            stdout=asyncio.subprocess.PIPE,
        )
        assert reader.stdout is not None
        lines = [await asyncio.wait_for(reader.stdout.readline(), 20) for _ in range(5)]
        reader.kill()
        await reader.wait()
        said = [json.loads(line) for line in lines]
        await rig.until("the same", lambda: rig.navs[-1].t_s * 1e3 > said[-1]["time"])
    navs = {(nav.utc_ns + 5_000_000) // 10_000_000: nav for nav in rig.navs}
    for one in said[1:]:  # the first may be of half an epoch
        nav = navs[one["time"] // 10]
        assert one["lat"] == pytest.approx(nav.lat_deg, abs=1e-7)
        assert one["lon"] == pytest.approx(nav.lon_deg, abs=1e-7)
        assert one["height"] == pytest.approx(nav.height_m, abs=0.006)
        assert one["GroundSpeed"] == pytest.approx(math.hypot(nav.vn_m_s, nav.ve_m_s), abs=0.006)
        if range_error_m is None:
            assert not {"HorizontalAccuracy", "VerticalAccuracy"} & one.keys()
            continue
        across = 2.0 * math.hypot(nav.sd_n_m, nav.sd_e_m)
        assert one["HorizontalAccuracy"] == pytest.approx(across, abs=2 * 0.0006 * RANGE_ERROR_M)
        assert one["VerticalAccuracy"] == pytest.approx(
            2.0 * nav.sd_d_m, abs=2 * 0.0006 * RANGE_ERROR_M
        )
