"""Start, pulled cables, lost power, restart of either side, and SIGTERM at each gateway's end.

``pytest tests/rig`` runs them in memory; ``pytest -m "slow and live" tests/rig`` on ptys, UDP and
TCP; ``pytest tests/rig --rig=serial:/dev/ttyUSB0,/dev/ttyUSB1`` on real ports.
"""

from typing import Any

import pytest

from tests.rig.sites import Site

HOVER = {
    "type": "line",
    "lat_deg": 39.80064,
    "lon_deg": 116.2,
    "height_m": 0.0,
    "course_deg": 90.0,
    "speed_m_s": 0.0,
}
"""Where the instruments may lose power without the vehicle being elsewhere afterwards."""


async def test_the_array_is_pulled_and_put_back(site: Site) -> None:
    async with site.gateway(), site.emulator():
        await site.until("a true position", site.is_right)
        site.unplug("usbl0")
        await site.until("dead reckoning", site.is_reckoning)
        site.plug("usbl0")
        await site.until("a true position again", site.is_right)
        await site.until("no loss of the other", lambda: site.counts("imu0")["records"] > 400)
        assert site.counts("imu0")["gaps"] == 0


async def test_the_imu_is_pulled_and_put_back(site: Site) -> None:
    async with site.emulator(), site.gateway():
        await site.until("a true position", site.is_right)
        site.unplug("imu0")
        await site.until("no claim", site.is_silent)
        site.plug("imu0")
        await site.until("a true position again", site.is_right)
        await site.until("the gap", lambda: site.counts("imu0")["gaps"] == 1)
        assert site.counts("imu0")["missing"] > 200


class TestPower:
    """The IMU is without power for a while, and begins to count anew."""

    @pytest.fixture
    def story(self) -> dict[str, Any]:
        return {"faults": [{"fault": "power_cycle", "device": "imu0", "at_s": 5.0, "for_s": 0.7}]}

    async def test_the_imu_loses_power(self, site: Site) -> None:
        async with site.gateway(), site.emulator():
            await site.until("a true position", site.is_right)
            await site.until("the gap", lambda: site.counts("imu0")["gaps"] == 1)
            await site.until("a true position again", site.is_right)
            assert site.counts("imu0")["rejected_bytes"] == 0


async def test_the_gateway_is_started_again(site: Site) -> None:
    async with site.emulator():
        async with site.gateway():
            await site.until("a true position", site.is_right)
            before = site.counts("imu0")["records"]
            await site.until("a state", lambda: site.counts("imu0")["records"] > before + 400)
        async with site.gateway():
            await site.until("a true position again", site.is_right)


class TestInstruments:
    """All instruments are without power for a while, where the vehicle does not move."""

    @pytest.fixture
    def story(self) -> dict[str, Any]:
        return {"trajectory": HOVER}

    async def test_the_instruments_are_started_again(self, site: Site) -> None:
        async with site.gateway():
            async with site.emulator():
                await site.until("a true position", site.is_right)
            await site.until("no claim", site.is_silent)
            async with site.emulator():
                await site.until("a true position again", site.is_right)
                await site.until("the gap", lambda: site.counts("imu0")["gaps"] == 1)
