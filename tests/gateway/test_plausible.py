"""What devices say that cannot be right: said once, shown while it lasts, trusted again."""

import math
import random
from collections.abc import Callable
from typing import Any

import pytest

from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.records import ImuRecord
from gateway.config import Config
from gateway.emulator import twin
from gateway.health.doubts import Doubt
from gateway.health.freed import STAYS_S
from gateway.health.plausible import (
    DOUBTED_AFTER,
    FIXES,
    TRUSTED_AFTER,
    WINDOW_S,
    Plausibility,
)
from gateway.ingest import Intake, intakes
from gateway.messages import Innovation
from gateway.schema import build
from tests.gateway.emulated import demo_data, make

UP = (0.0, 0.0, -9.81)
STILL = (0.0, 0.0, 0.0)


class Sea:
    """Lines of the demo's configuration and a clock that the test moves."""

    def __init__(self) -> None:
        config = build(Config, twin.gateway_config(make(demo_data())), [])
        assert config is not None
        self.ways = intakes(config)
        self.now = 1000.0
        self.sequence = 0
        self.plausibility = Plausibility([self.imu, self.usbl])
        self.plausibility.look(self.now)

    @property
    def imu(self) -> Intake:
        return self.ways["imu0"]

    @property
    def usbl(self) -> Intake:
        return self.ways["usbl0"]

    def feel(
        self,
        windows: int,
        force: tuple[float, float, float] = UP,
        turn: tuple[float, float, float] = STILL,
        rate_hz: float = 200.0,
    ) -> None:
        """Let the unit, which is declared at 200 Hz, feel something for some windows."""
        ingest = self.imu.ingests["imu0"]
        for _ in range(windows):
            count = round(WINDOW_S * rate_hz)
            for n in range(count):
                t_ns = round((self.now + (n + 1) * WINDOW_S / count) * 1e9)
                ingest.take(
                    ImuRecord(
                        t_rx_ns=t_ns,
                        sequence=self.sequence,
                        rate_rad_s=turn,
                        specific_force_m_s2=force,
                    )
                )
                ingest.end_of_chunk()
                self.sequence = (self.sequence + 1) % 128
            self.imu.flush()
            self.look()

    def look(self) -> list[Doubt]:
        """Let a window pass."""
        self.now += WINDOW_S
        self.plausibility.look(self.now)
        return self.plausibility.doubts

    def moved(self, *metres: tuple[float, float, float]) -> None:
        """Let the filter, which doubts itself, use fixes that take the place so far."""
        for moved in metres:
            verdict = Innovation(0, "usbl0", "1", (), 1.0, True, "", moved=moved)
            self.plausibility.verdict(verdict)

    def judged(self, used: int, refused: int, reason: str = "gate", beacon: str = "1") -> None:
        """Let the filter say what it made of fixes."""
        for accepted in [True] * used + [False] * refused:
            why = "" if accepted else reason
            verdict = Innovation(0, "usbl0", beacon, (), math.nan, accepted, why)
            self.plausibility.verdict(verdict)


@pytest.fixture
def sea() -> Sea:
    return Sea()


def test_a_healthy_vehicle_is_not_doubted(sea: Sea, said: Callable[[], list[str]]) -> None:
    tilted = (9.81 * math.sin(0.7), 0.0, -9.81 * math.cos(0.7))
    sea.feel(3, turn=(0.0, 0.0, 0.5))
    sea.feel(3, force=tilted, rate_hz=190.0)
    sea.judged(used=300, refused=60)
    assert sea.look() == []
    assert said() == []


@pytest.mark.parametrize(
    ("felt", "text"),
    [
        (
            {"force": (0.0, 0.0, 9.81)},
            "by gravity the sky is down of the vehicle's axes: its mounting_deg?",
        ),
        (
            {"force": (0.0, -9.81, 0.3)},
            "by gravity the sky is port of the vehicle's axes: its mounting_deg?",
        ),
        (
            {"force": (0.0, 0.0, -1.0)},
            "feels 1 m/s2 where gravity is 9.8: the unit of its accelerometers (options)?",
        ),
        (
            {"turn": (0.0, 0.0, 2.0)},
            "turns by 115 deg a second all the time: the unit of its gyros (options)?",
        ),
        ({"rate_hz": 100.0}, "100 samples a second, rate_hz says 200"),
    ],
)
def test_what_an_inertial_unit_cannot_feel(
    sea: Sea, said: Callable[[], list[str]], felt: dict[str, Any], text: str
) -> None:
    sea.feel(DOUBTED_AFTER - 1, **felt)
    assert said() == []
    sea.feel(4, **felt)
    assert said() == [f"imu0: {text}"]
    assert sea.plausibility.doubts == [Doubt("imu0", text)]
    sea.feel(TRUSTED_AFTER - 1)
    assert said() == []
    sea.feel(3)  # a rate is judged by three windows that are alike
    (again,) = said()
    assert again.endswith("is as it should be again")
    assert sea.plausibility.doubts == []


def test_a_cable_that_is_pulled_is_no_other_rate(sea: Sea, said: Callable[[], list[str]]) -> None:
    for _ in range(3):
        sea.feel(2)
        sea.feel(1, rate_hz=90.0)  # pulled
        sea.look()
        sea.feel(1, rate_hz=60.0)  # and plugged
        sea.feel(1)
        sea.feel(1, rate_hz=40.0)  # pulled for some seconds
        sea.feel(1, rate_hz=50.0)
    assert said() == []


def test_what_waited_while_the_gateway_stood_still_is_no_other_rate(
    sea: Sea, said: Callable[[], list[str]]
) -> None:
    sea.feel(2)
    sea.feel(1, rate_hz=40.0)  # little was read before it stood still
    sea.plausibility.start_over()
    sea.feel(1, rate_hz=1000.0)
    sea.feel(2)
    assert said() == []


def test_bytes_that_are_of_another_format(sea: Sea, said: Callable[[], list[str]]) -> None:
    for _ in range(3):
        sea.usbl.feed(b"$PHTRO,1.1,M,2.2,B*55\r\n" * 10, 1)
        sea.look()
    text = "230 of 230 bytes make no frame of tracklink-lxt: its codec, options or baud rate?"
    assert said() == [f"usbl0: {text}"]
    for _ in range(20):  # silence says nothing of the format
        assert sea.look() == [Doubt("usbl0", text)]


def test_lines_that_were_swapped(sea: Sea, said: Callable[[], list[str]]) -> None:
    frame = KVH1750.encode(
        ImuRecord(
            t_rx_ns=0,
            sequence=1,
            delta_angle_rad=(0.0, 0.0, 0.0),
            specific_force_m_s2=(0.0, 0.0, -9.8),
        ),
        KvhOptions(),
    )
    for _ in range(3):
        for _ in range(100):
            sea.usbl.feed(frame, 1)
        sea.look()
    (text,) = said()
    assert text.startswith("usbl0: ")
    assert text.endswith(
        " of 3600 bytes make no frame of tracklink-lxt, but of kvh1750,"
        " as imu0 is said to speak: cables swapped?"
    )


def test_sentences_of_another_kind_of_device(said: Callable[[], list[str]]) -> None:
    """A compass on the cable of the depth sensor: all of it is NMEA."""
    data = twin.gateway_config(make(demo_data()))
    link = {"type": "udp", "port": 7009}
    data["devices"]["depth0"] = {"kind": "depth", "codec": "nmea-depth", "link": link} | {
        "surface_height_m": 0.0,
        "noise": {"depth_m": 0.1},
        "options": {"measures": "depth"},
    }
    faults: list[str] = []
    config = build(Config, data, faults)
    assert config is not None, faults
    depth = intakes(config)["depth0"]
    plausibility = Plausibility([depth])
    heading, sounding = b"$GPHDT,10.0,T*04\r\n", b"$SDDPT,10.0,0.0*66\r\n"
    for n in range(4):
        plausibility.look(WINDOW_S * n)
        for _ in range(7):
            depth.feed(heading, n)
    text = "7 sentences came, and none of a depth device: another one's cable?"
    assert plausibility.doubts == [Doubt("depth0", text)]
    assert said() == [f"depth0: {text}"]
    for n in range(4, 12):
        depth.feed(sounding, n)
        depth.feed(heading, n)
        plausibility.look(WINDOW_S * n)
    assert plausibility.doubts == []


def test_noise_that_is_rejected_in_lumps(sea: Sea, said: Callable[[], list[str]]) -> None:
    noise = random.Random(7)
    for _ in range(6):
        for _ in range(20):
            sea.imu.feed(noise.randbytes(36), 1)
        sea.look()
    assert said() == [
        "imu0: 720 of 720 bytes make no frame of kvh1750: its codec, options or baud rate?"
    ]


def test_fixes_that_mostly_do_not_fit(sea: Sea, said: Callable[[], list[str]]) -> None:
    sea.judged(used=2, refused=FIXES)
    sea.look()
    sea.judged(used=1, refused=FIXES)
    sea.look()
    assert said() == [
        f"usbl0: {FIXES} of {FIXES + 1} fixes do not fit: beacon's place, mounting, latency?"
    ]


def test_a_beacon_that_the_configuration_does_not_know(
    sea: Sea, said: Callable[[], list[str]]
) -> None:
    for used in (1, 1, 1, 0, 0):
        sea.judged(used=used, refused=0)
        sea.judged(used=0, refused=5, reason="unknown_beacon", beacon="7")
        assert said() == []
        sea.look()
    assert said() == ['usbl0: hears beacon "7", of which the configuration does not know']


def test_where_the_filter_gave_in_is_said_once_and_how_far(
    sea: Sea, said: Callable[[], list[str]]
) -> None:
    """A beacon that is configured 100 m off, or a start that was wrong: who knows?"""
    text = (
        'the place went 99 m north, 3 m west, 4 m up to fit 10 fixes of beacon "1",'
        " which were refused: was it wrong, or is what they are told from?"
    )
    sea.judged(used=5, refused=10)
    sea.moved((99.5, -3.2, -4.1), (-0.5, 0.2, -0.3))
    assert sea.look() == []
    sea.judged(used=1, refused=0)
    assert sea.look() == [Doubt("usbl0", text)]
    assert said() == [f"usbl0: {text}"]
    while sea.now < 1000.0 + STAYS_S:
        assert sea.look() == [Doubt("usbl0", text)]
    sea.look()
    sea.look()
    assert sea.look() == []
    assert said() == []


def test_an_outlier_or_a_small_step_is_no_giving_in(sea: Sea) -> None:
    sea.judged(used=5, refused=1)
    sea.judged(used=5, refused=10)
    sea.moved((0.3, 0.2, 0.1))
    sea.judged(used=5, refused=0)
    sea.moved((50.0, 0.0, 0.0))  # of nothing that was refused
    sea.judged(used=5, refused=0)
    assert sea.look() == []
