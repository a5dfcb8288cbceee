"""What a wide mission has beside an ordinary one: other instruments, and what befalls sound."""

from tests.campaign.dice import Data, Dice

DVLS: list[Data] = [
    {"codec": "pd0"},
    {"codec": "pd6"},
    {"codec": "nortek-dvl", "age_ms": 120.0},
    {"codec": "waterlinked-dvl", "age_ms": 80.0},
]
DEPTHS: list[Data] = [
    {"codec": "nmea-depth", "options": {"measures": "depth"}},
    {"codec": "paroscientific"},
    {"codec": "nmea-bus", "options": {"measures": "depth"}},
]
HEADINGS: list[Data] = [
    {"codec": "nmea-heading"},
    {"codec": "nmea-heading", "attitude": True},
    {"codec": "nmea-heading", "attitude": True, "clock": {"source": "device", "latency_ms": 20.0}},
    {"codec": "phins"},
    {"codec": "phins", "attitude": True},
    {"codec": "nmea-bus"},
]
RECEIVERS: list[Data] = [
    {"codec": "nmea-gnss"},
    {"codec": "nmea-gnss", "says": ["GNS", "VTG"]},
    {"codec": "nmea-bus"},
]
INTERROGATORS: list[Data] = [
    {"codec": "micromodem", "asks": "together"},
    {"codec": "micromodem", "asks": "in_turn"},
]
UNMARKED = ("anpp", "stdbin")
"""Formats that cannot say of a sample that it was cut: no filter can know it."""
TIMED = ("pd0", "waterlinked-dvl", "nmea-gnss")
"""Formats that tell when something was measured, as finely as they measure."""


def widened(dice: Dice, number: int, data: Data) -> Data:
    """A mission with some of the other instruments and up to three more faults.

    Codecs come in turn, all else is drawn.
    """
    bed_m = -min(b["height_m"] for b in data["beacons"].values()) + dice.between(0, 30)
    others = {
        "gnss0": lambda: _receiver(dice, RECEIVERS[number % len(RECEIVERS)]),
        "depth0": lambda: _depth(dice, DEPTHS[number % len(DEPTHS)]),
        "dvl0": lambda: _log(dice, DVLS[number % len(DVLS)]),
        "heading0": lambda: _compass(dice, HEADINGS[number % len(HEADINGS)]),
        "lbl0": lambda: _interrogator(dice, INTERROGATORS[number % len(INTERROGATORS)], data),
    }
    chosen = [name for name in others if dice.chance(0.4)] or [dice.one(*others)]
    devices = {name: others[name]() for name in chosen}
    whole = data | {"sea_bed_depth_m": bed_m, "devices": data["devices"] | devices}
    faults = [_of_bytes(dice, name, devices[name], data["duration_s"]) for name in chosen]
    faults = [fault for fault in faults if fault and dice.chance(0.5)]
    faults += [_beyond(dice, whole) for _ in range(dice.whole(0, 2))]
    return whole | {"faults": [*data["faults"], *filter(None, faults)]}


def _port(dice: Dice, name: str, port: int) -> Data:
    udp: Data = {"type": "udp", "port": port}
    tcp: Data = {"type": "tcp-server", "port": port}
    pty: Data = {"type": "pty", "symlink": f"/tmp/campaign-{name}", "baud": 38400}
    return {"port": dice.one(udp, tcp, pty)}


def _clock(dice: Dice, codec: str) -> Data:
    source = dice.one("arrival", "device") if codec in TIMED else "arrival"
    return {"clock": {"source": source, "latency_ms": dice.between(0, 200)}}


def _receiver(dice: Dice, how: Data) -> Data:
    sd_m = dice.between(0.02, 3)
    return {
        "kind": "gnss",
        "rate_hz": dice.one(1.0, 5.0),
        "lever_arm_m": [dice.between(-2, 2), dice.between(-1, 1), -dice.between(1, 3)],
        "noise": {"position_m": [sd_m, sd_m, 2 * sd_m], "velocity_m_s": dice.between(0.03, 0.2)},
        "geoid_m": dice.between(-50, 50),
        **_clock(dice, how["codec"]),
        **_port(dice, "gnss0", 7003),
        **how,
    }


def _depth(dice: Dice, how: Data) -> Data:
    return {
        "kind": "depth",
        "rate_hz": dice.one(1.0, 4.0, 10.0),
        "lever_arm_m": [dice.between(-1, 1), dice.between(-0.5, 0.5), dice.between(1.5, 3)],
        "noise": {"depth_m": dice.between(0.02, 0.2)},
        **_clock(dice, how["codec"]),
        **_port(dice, "depth0", 7004),
        **how,
    }


def _log(dice: Dice, how: Data) -> Data:
    sd_m_s = dice.between(0.005, 0.05)
    return {
        "kind": "dvl",
        "rate_hz": dice.one(1.0, 5.0, 8.0),
        "mounting_deg": dice.one([0, 0, 0], [0, 0, 45]),
        "lever_arm_m": [dice.between(-1, 1), dice.between(-0.5, 0.5), dice.between(0, 1)],
        "noise": {"velocity_m_s": [sd_m_s, sd_m_s, 0.5 * sd_m_s]},
        "altitude_limits_m": [0.5, dice.one(60.0, 120.0, 300.0)],
        **_clock(dice, how["codec"]),
        **_port(dice, "dvl0", 7005),
        **how,
    }


def _compass(dice: Dice, how: Data) -> Data:
    return {
        "kind": "heading",
        "rate_hz": dice.one(1.0, 10.0),
        "mounting_deg": dice.one([0, 0, 0], [0, 0, 90]),
        "noise": {"heading_deg": dice.between(0.2, 2)},
        **_clock(dice, how["codec"]),
        **_port(dice, "heading0", 7006),
        **how,
    }


def _interrogator(dice: Dice, how: Data, data: Data) -> Data:
    """It asks the same beacons as the array, which has its own ping."""
    names = [*data["beacons"], "9", "8", "7"][:4]
    together = how["asks"] == "together"
    return {
        "kind": "lbl",
        "options": {"transponders": names},
        "period_s": dice.between(2, 10),
        "timeout_s": dice.between(1.0, 1.8),
        "missed_probability": dice.one(0.0, 0.1),
        "outliers": {"probability": dice.one(0.0, 0.02)},
        "clock": {
            "source": dice.one("arrival", "device") if together else "arrival",
            "latency_ms": dice.between(10, 200),
        },
        "lever_arm_m": [dice.between(-2, 2), dice.between(-1, 1), dice.between(0, 2)],
        "noise": {"range_m": dice.between(0.1, 1)},
        **_port(dice, "lbl0", 7007),
        **how,
    }


def _of_bytes(dice: Dice, name: str, model: Data, duration_s: float) -> Data | None:
    """Something that strikes what an instrument says, or its clock where that is heard."""
    kinds = ["flip", "truncate", "junk", "duplicate", "reorder", "drop", "unplug", "power_cycle"]
    if model["clock"]["source"] == "device":
        kinds += ["clock_drift", "clock_step"]
    block: Data = {"fault": dice.one(*kinds), "device": name}
    at: Data = {"at_s": dice.between(0.1 * duration_s, 0.8 * duration_s)}
    match block["fault"]:
        case "clock_drift":
            return block | at | {"ppm": dice.between(-80, 80)}
        case "clock_step":
            return block | at | {"step_s": dice.one(-1, 1) * dice.one(0.3, 3.0, 500.0)}
        case "unplug" | "power_cycle":
            return block | at | {"for_s": dice.between(1, 60)}
    return block | at | {"for_s": dice.between(5, 60), "probability": dice.one(0.1, 0.5, 1.0)}


def _beyond(dice: Dice, data: Data) -> Data | None:
    """Something that befalls the sound, a beacon or the inertial unit itself."""
    kind = dice.one("multipath", "beacon_dead", "beacon_moved", "saturation")
    acoustic = [n for n, d in data["devices"].items() if d["kind"] in ("usbl", "lbl")]
    at_s = dice.between(0.1 * data["duration_s"], 0.8 * data["duration_s"])
    block: Data = {"fault": kind, "at_s": at_s}
    match kind:
        case "multipath":
            share = {"probability": dice.one(0.3, 0.7, 1.0)}
            return block | share | {"device": dice.one(*acoustic), "for_s": dice.between(5, 60)}
        case "beacon_dead":
            beacon = dice.one(*data["beacons"])
            return block | {"beacon": beacon, "for_s": dice.between(10, 120)}
        case "beacon_moved":
            away = {"north_m": dice.between(-60, 60), "east_m": dice.between(-60, 60)}
            moved = block | away | {"beacon": dice.one(*data["beacons"])}
            return moved if _others_know(data) else None
    rates = {"rate_deg_s": dice.one(1.0, 4.0, 100.0), "accel_g": dice.one(1.003, 1.02, 5.0)}
    narrow = block | rates | {"device": "imu0", "for_s": dice.between(0.2, 5)}
    return narrow if data["devices"]["imu0"]["codec"] not in UNMARKED else None


def _others_know(data: Data) -> bool:
    """Whether a beacon that has gone astray contradicts others: without, nobody can know."""
    surfaced = data["trajectory"]["height_m"] == 0.0 and "gnss0" in data["devices"]
    return surfaced or len(data["beacons"]) >= 3
