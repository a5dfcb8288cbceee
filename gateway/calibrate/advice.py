"""Which manoeuvre would tell two constants apart, or one of them at all."""

_KINDS = {
    "mounting": "mounting",
    "elevation": "elevation",
    "bearing": "bearing",
    "range": "range",
    "lever": "lever",
    "latency": "latency",
    "gyro": "gyro",
    "accel": "accel",
    "roll": "level",
    "pitch": "level",
    "heading": "heading",
}
"""First word of a constant's name -> kind."""

_PAIRS = {
    ("bearing", "mounting"): (
        "no manoeuvre of a level vehicle parts them; their difference is what counts, and it is"
        " given as bearing_turn_deg"
    ),
    ("bearing", "heading"): "turn and change speed: that makes the heading known by itself",
    ("heading", "mounting"): (
        "turn and change speed, on reciprocal courses: that makes the heading known by itself"
    ),
    ("level", "mounting"): "turn through all headings: that parts the level from the mounting",
    ("accel", "mounting"): "turn through all headings: that makes the accelerometer biases known",
    ("elevation", "mounting"): (
        "see the beacon ahead, abeam and astern: pass it, do not only circle it"
    ),
    ("mounting", "mounting"): "see the beacon ahead, abeam and astern, on both sides",
    ("elevation", "range"): "see the beacon from near and from far",
    ("elevation", "lever"): "see the beacon from near and from far: only an angle keeps its size",
    ("lever", "mounting"): "see the beacon from near and from far: only an angle keeps its size",
    ("bearing", "lever"): "see the beacon from near and from far: only an angle keeps its size",
    ("latency", "lever"): "pass the beacon at two speeds: only the latency's shift grows with it",
    ("latency", "mounting"): "pass the beacon at two speeds and at two distances",
    ("bearing", "latency"): "pass the beacon at two speeds and at two distances",
    ("latency", "range"): "sail towards the beacon and away from it at full speed",
    ("lever", "range"): "see the beacon from near and from far, on both sides",
    ("lever", "lever"): "turn on the spot near the beacon, on both sides of it",
}
_ALONE = {
    "mounting": "pass the beacon on both sides, on reciprocal courses, with turns between",
    "bearing": "pass the beacon on both sides, on reciprocal courses, with turns between",
    "elevation": "pass the beacon near and far, ahead, abeam and astern",
    "range": "see the beacon from near and from far",
    "lever": "pass close to the beacon, with turns",
    "latency": "pass the beacon on reciprocal courses at two speeds",
}
_DEFAULT = "vary course, speed and distance to the beacon"


def kind(name: str) -> str:
    """What sort of constant a name is of."""
    return _KINDS[name.split("_", 1)[0]]


def to_part(one: str, other: str) -> str:
    """What would tell two constants apart."""
    a, b = sorted((kind(one), kind(other)))
    return _PAIRS.get((a, b), _DEFAULT)


def to_see(name: str) -> str:
    """What would show a constant that the run told little of."""
    return _ALONE.get(kind(name), _DEFAULT)
