"""A solution with a different number in every field."""

import math

import msgspec

from gateway.messages import NavSolution
from gateway.modes import Mode

SOLUTION = NavSolution(
    t_ns=5_000_000_001,
    mode=Mode.AIDED,
    lat=math.radians(39.8),
    lon=math.radians(116.2),
    h=-50.25,
    v_eb_n=(3.0, -0.5, 0.25),
    roll=math.radians(-1.5),
    pitch=math.radians(2.5),
    heading=math.radians(-10.0),
    sd_position=(0.3, 0.4, 0.5),
    sd_velocity=(0.01, 0.02, 0.03),
    sd_attitude=(math.radians(0.1), math.radians(0.2), math.radians(0.3)),
    cov_ne=0.05,
    fix_age_s=1.5,
    fixes_used=12,
    fixes_rejected=3,
)


def solution(**changes: object) -> NavSolution:
    return msgspec.structs.replace(SOLUTION, **changes)
