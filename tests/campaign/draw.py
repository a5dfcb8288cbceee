"""One mission by its seed and number: a vehicle, its instruments, its way, and what goes wrong."""

from gateway.config.doubts import POOR_HEADING_DEG
from tests.campaign.dice import Data, Dice
from tests.campaign.wide import widened

START = 1_780_000_000.0
LAT_DEG, LON_DEG = 39.8, 116.2

IMUS: dict[str, list[Data]] = {
    "kvh1750": [{}, {"format": "b"}, {"format": "c", "gyro": "rate_deg_s", "accel": "delta_v_m_s"}],
    "stim300": [{}, {"with_temperature": True, "gyro": "increment", "accel": "increment"}],
    "novatel-span": [{"imu": "kvh1750"}, {"imu": "stim300", "log": "rawimux", "ascii": True}],
    "vectornav": [{}, {"prefer": "rates"}],
    "xsens-mtdata2": [{}, {"prefer": "rates"}],
    "mip": [{}, {"prefer": "rates"}],
    "sbg-ecom": [{}],
    "anpp": [{}, {"with_time": True}],
    "stdbin": [{}, {"version": 3}],
    "hg4930": [{}],
}
USBLS: dict[str, list[Data]] = {
    "tracklink-lxt": [{}],
    "tracklink-tp2": [{}],
    "tracklink-log": [{}],
    "tracklink-gll": [{"axes": "earth", "options": {"beacon": "1"}}],
    "evologics": [{}, {"options": {"framed": True}}],
    "psimssb": [{"options": {"levelled": False}}, {"axes": "level"}, {"axes": "north"}],
    "gaps": [{"axes": "level"}, {"axes": "north"}, {"axes": "earth"}],
    "psonlld": [{"axes": "earth"}],
    "pazm3": [{"options": {"checksum": "required"}}, {"no_reply": "timeout"}],
    "usrth": [{"options": {"beacon": "1"}}],
    "seatrac": [{}],
    "micronnav": [{"axes": "level"}, {"options": {"levelled": False}}],
}
"""As `UsblModel` says them. A place by the topside's own position is heard, not used."""
TIMED = ("evologics", "psimssb", "gaps")
"""Formats that tell the time to better than a second."""
UNCOUNTED = ("hg4930", "anpp")
"""Formats that neither count nor time their samples: one lost or said twice cannot be told."""
NUMBERED = ("kvh1750", "stim300", "xsens-mtdata2", "stdbin")
"""Formats that count their samples, whatever these are placed by."""
ERRORS = ("right_invariant", "right_invariant", "left_invariant", "additive")
GRADES: dict[str, tuple[Data, list[float]]] = {
    "navigation": (
        {
            "angle_random_walk_deg_sqrt_h": 0.002,
            "gyro_bias_deg_h": 0.02,
            "velocity_random_walk_ug_sqrt_hz": 20.0,
            "accel_bias_ug": 50.0,
        },
        [0.02, 0.02, 0.1],
    ),
    "tactical": (
        {
            "angle_random_walk_deg_sqrt_h": 0.02,
            "gyro_bias_deg_h": 0.5,
            "velocity_random_walk_ug_sqrt_hz": 60.0,
            "accel_bias_ug": 500.0,
        },
        [0.1, 0.1, 0.5],
    ),
    "mems": (
        {
            "angle_random_walk_deg_sqrt_h": 0.15,
            "gyro_bias_deg_h": 8.0,
            "velocity_random_walk_ug_sqrt_hz": 60.0,
            "accel_bias_ug": 2000.0,
            "gyro_bias_correlation_s": 1000.0,
            "accel_bias_correlation_s": 1000.0,
        },
        [0.5, 0.5, 2.0],
    ),
}


def mission(
    seed: int, number: int, longest_s: float = 600.0, *, wide: bool = False
) -> tuple[Data, str]:
    """The scenario of a mission as plain data, and its filter's error definition.

    Codecs come in turn, all else is drawn; what makes it wide is drawn by itself, so that a mission
    without is the same as ever.
    """
    dice = Dice(seed, number)
    duration_s = round(dice.between(0.2 * longest_s, longest_s))
    imu, sigma = _imu(dice, list(IMUS)[number % len(IMUS)])
    usbl = _usbl(dice, list(USBLS)[(number + number // len(IMUS)) % len(USBLS)])
    devices = {"imu0": imu, "usbl0": usbl}
    beacons = _beacons(dice, most=1 if "beacon" in usbl.get("options", {}) else 3)
    data = {
        "seed": (seed * 1_000_003 + number) % 2**32,
        "duration_s": duration_s,
        "start": START,
        "trajectory": _way(dice),
        "devices": devices,
        "beacons": beacons,
        "sound_speed_m_s": dice.between(1450, 1540),
        "initial": {
            "sigma": {"position_m": [5.0, 5.0, 1.0], "velocity_m_s": 0.2, "attitude_deg": sigma}
        },
    }
    data |= {"faults": _faults(dice, data)}
    error = dice.one(*ERRORS)
    if len(beacons) == 1 and sigma[2] >= POOR_HEADING_DEG:
        error = "right_invariant"  # `usblnav check` advises against any other
    return (widened(Dice(seed, number, "wide"), number, data) if wide else data), error


def _way(dice: Dice) -> Data:
    """A way that stays about the beacons."""
    speed = dice.between(0.5, 3.0)
    common = {
        "lat_deg": LAT_DEG,
        "lon_deg": LON_DEG,
        "height_m": dice.one(0.0, -10.0),
        "speed_m_s": speed,
        "ramp_s": dice.one(0.0, 20.0),
        "sway": {
            "roll": [{"amplitude": dice.between(0.5, 6), "period_s": dice.between(5, 9)}],
            "pitch": [{"amplitude": dice.between(0.3, 3), "period_s": dice.between(5, 9)}],
            "yaw": [{"amplitude": dice.between(0, 2), "period_s": dice.between(8, 15)}],
            "heave": [{"amplitude": dice.between(0, 0.5), "period_s": dice.between(6, 10)}],
        },
    }
    leg_m = dice.between(60, 150)
    kinds: list[Data] = [
        {
            "type": "circle",
            "radius_m": dice.between(30, 100),
            "turn": dice.one("port", "starboard"),
        },
        {"type": "lawnmower", "leg_m": leg_m, "spacing_m": dice.between(25, 60)},
        {"type": "line"},
        {"type": "legs", "leg_m": leg_m, "turn_m": 40.0, "turns_deg": [90.0] * 40},
    ]
    chosen = dice.one(*kinds)
    if chosen["type"] == "circle":
        return common | chosen | {"start_bearing_deg": dice.between(0, 360)}
    return common | chosen | {"course_deg": dice.between(0, 360)}


def _beacons(dice: Dice, most: int) -> Data:
    """One or some on the ground."""
    return {
        str(name): {
            "lat_deg": LAT_DEG + dice.between(-60, 60) / 111_000,
            "lon_deg": LON_DEG + dice.between(-60, 60) / 85_000,
            "height_m": -dice.between(50, 150),
            "turnaround_ms": dice.one(0.0, 30.0),
        }
        for name in range(1, dice.whole(1, most) + 1)
    }


def _imu(dice: Dice, codec: str) -> tuple[Data, list[float]]:
    noise, sigma = GRADES[dice.one(*GRADES)]
    ports: list[Data] = [
        {"type": "udp", "port": 7001},
        {"type": "tcp-server", "port": 7001},
        {"type": "pty", "symlink": "/tmp/campaign-imu0", "baud": 921600},
    ]
    model = {
        "kind": "imu",
        "codec": codec,
        "options": dice.one(*IMUS[codec]),
        "port": dice.one(*ports),
        "rate_hz": dice.one(100.0, 125.0, 200.0),
        "noise": noise,
        "clock": {
            "source": dice.one("device", "arrival") if codec in NUMBERED else "device",
            "latency_ms": dice.between(0, 5),
        },
        "uptime_s": dice.between(1000, 4000),
        "jitter_ms": dice.one(0.0, 0.5, 2.0),
        "mounting_deg": dice.one([0, 0, 0], [180, 0, 0], [0, 0, 90]),
    }
    return model, sigma


def _usbl(dice: Dice, codec: str) -> Data:
    angle = dice.between(0.25, 1.0)
    ports: list[Data] = [
        {"type": "udp", "port": 7002},
        {"type": "pty", "symlink": "/tmp/campaign-usbl0", "baud": dice.one(9600, 38400)},
    ]
    noise = {"bearing_deg": angle, "elevation_deg": angle, "range_m": dice.between(0.1, 0.4)}
    common = {
        "kind": "usbl",
        "codec": codec,
        "port": dice.one(*ports),
        "clock": {
            "source": dice.one("arrival", "device") if codec in TIMED else "arrival",
            "latency_ms": dice.between(50, 800),
        },
        "period_s": dice.between(1, 4),
        "lever_arm_m": [dice.between(-2, 2), dice.between(-1, 1), dice.between(0, 2)],
        "prior": {"mounting_deg": dice.one(0.0, 0.1, 0.5), "range_scale": dice.one(0.0, 0.002)},
        "outliers": {"probability": dice.one(0.0, 0.0, 0.02, 0.05)},
        "missed_probability": dice.one(0.0, 0.1),
    }
    chosen = dice.one(*USBLS[codec])
    if chosen.get("axes") in ("level", "north"):
        noise |= {"tilt_deg": 0.1, "heading_deg": 0.3}
        common["prior"] = {"range_scale": common["prior"]["range_scale"]}
    return common | chosen | {"noise": noise}


def _faults(dice: Dice, data: Data) -> list[Data]:
    """None in one mission of eight, else up to four."""
    if dice.chance(1 / 8):
        return []
    faults = [_fault(dice, data["duration_s"]) for _ in range(dice.whole(1, 4))]
    imu = data["devices"]["imu0"]
    counted = imu["codec"] not in UNCOUNTED or imu["options"].get("with_time", False)
    return [
        f for f in faults if counted or not (f["fault"] in _OF_FRAMES and f["device"] == "imu0")
    ]


def _fault(dice: Dice, duration_s: float) -> Data:
    kind = dice.one(*_OF_ANY, *_OF_IMU)
    device = "imu0" if kind in _OF_IMU else dice.one("imu0", "usbl0")
    block: Data = {"fault": kind, "device": device}
    at_s = dice.between(0.1 * duration_s, 0.9 * duration_s)
    long = device == "usbl0"
    match kind:
        case "flip" | "truncate" | "junk" | "duplicate" | "reorder" | "drop":
            if dice.chance(0.5):
                block |= {"per_hour": dice.between(60, 1200), "for_s": dice.one(0.0, 0.1)}
            else:
                block |= {"at_s": at_s, "for_s": dice.between(0.1, 30.0 if long else 3.0)}
                block |= {"probability": dice.one(0.1, 0.5, 1.0)}
            if kind == "flip":
                block |= {"bits": dice.one(1, 1, 2, 8)}
            if kind == "junk":
                block |= {"bytes": dice.one(4, 64, 600)}
        case "unplug" | "power_cycle":
            block |= {"at_s": at_s, "for_s": dice.between(0.5, 40.0 if long else 8.0)}
        case "burst":
            block |= {"at_s": at_s, "for_s": dice.between(0.1, 3.0)}
        case "delay":
            block |= {"at_s": at_s, "for_s": dice.between(0.5, 4.0)}
            block |= {"delay_ms": dice.between(5, 300)}
        case "jitter":
            block |= {"at_s": at_s, "for_s": dice.between(1, 60), "mean_ms": dice.between(1, 20)}
        case "clock_drift":
            block |= {"at_s": at_s, "ppm": dice.between(-80, 80)}
        case "clock_step":
            block |= {"at_s": at_s, "step_s": dice.one(-1, 1) * dice.one(0.002, 0.3, 3.0, 500.0)}
        case "clock_wrap":
            block |= {"at_s": at_s}
    return block


_OF_FRAMES = ("flip", "truncate", "junk", "duplicate", "reorder", "drop")
_OF_ANY = (*_OF_FRAMES, "unplug", "power_cycle", "jitter")
_OF_IMU = ("burst", "delay", "clock_drift", "clock_step", "clock_wrap")
"""A sentence that is timed by its arrival cannot be known to be late: bursts and delays of fixes
are a wrong latency, which no filter can see."""
