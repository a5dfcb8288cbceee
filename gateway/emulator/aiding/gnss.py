"""The satellite receiver: position and velocity of an antenna that is out of the water."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from drivers.records import GnssRecord, Record, TimeRecord
from gateway.emulator.aiding.sensing import Aboard, Array
from gateway.emulator.scenario.aiding import GnssModel, Sentence
from gateway.nav import earth

_MODES = {1: "A", 2: "D", 3: "P", 4: "R", 5: "F"}
"""Of the other sentences, by the quality of GGA."""
_NO_FIX = "N"
_HDOP = 0.8


class _Epoch(NamedTuple):
    """What the receiver found: degrees, m, m/s north and east; ``unix_s`` what it tells."""

    lat_deg: float
    lon_deg: float
    height_m: float
    north: float
    east: float
    unix_s: float
    fix: bool


class Receiver:
    """Sentences of epochs in their order."""

    def __init__(self, on: Aboard[GnssModel]) -> None:
        self._on = on
        self._noise = on.draws()

    def say(self, t: Array) -> Iterator[tuple[Record, ...]]:
        """The sentences of epochs at times (n,) s."""
        for epoch in self._epochs(t):
            yield tuple(self._record(sentence, epoch) for sentence in self._on.model.says)

    def _epochs(self, t: Array) -> Iterator[_Epoch]:
        on, model = self._on, self._on.model
        white = self._noise.standard_normal((t.size, 5))
        r_e, v_e = on.trajectory.point(t, model.lever_arm_m)
        lat, lon, h = earth.ecef_to_lla(r_e)
        C_en = earth.C_en(lat, lon)
        error_n = white[:, :3] * model.noise.position_m
        found = earth.ecef_to_lla(r_e + np.einsum("nij,nj->ni", C_en, error_n))
        v_n = np.einsum("nij,ni->nj", C_en, v_e)[:, :2] + model.noise.velocity_m_s * white[:, 3:]
        fix = h >= on.scenario.surface_height_m - model.max_depth_m
        columns = *np.rad2deg(found[:2]), found[2], *v_n.T, on.told_unix_s(t), fix
        return map(_Epoch._make, zip(*(column.tolist() for column in columns), strict=True))

    def _record(self, sentence: Sentence, epoch: _Epoch) -> Record:
        if sentence == "ZDA":
            return TimeRecord(t_rx_ns=0, unix_s=epoch.unix_s)
        model = self._on.model
        none = GnssRecord(
            t_rx_ns=0,
            sentence=sentence,
            valid=False,
            t_device_s=epoch.unix_s % 86_400.0,
            quality=0,
            mode=_NO_FIX,
        )
        if not epoch.fix:
            return none
        found = replace(
            none,
            valid=True,
            quality=model.quality,
            mode=_MODES[model.quality],
            lat_deg=epoch.lat_deg,
            lon_deg=epoch.lon_deg,
            satellites=model.satellites,
            hdop=_HDOP,
            height_m=epoch.height_m,
            geoid_m=model.geoid_m,
        )
        if sentence in ("GGA", "GNS"):
            return found
        course = float(np.rad2deg(np.arctan2(epoch.east, epoch.north)) % 360.0)
        speed = float(np.hypot(epoch.north, epoch.east))
        return replace(found, speed_m_s=speed, course_deg=course)
