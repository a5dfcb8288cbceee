"""The pressure sensor and the echo sounder: water above and below."""

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from drivers.records import DepthRecord, Record
from gateway.emulator.aiding.sensing import Aboard, Array
from gateway.emulator.scenario import DepthModel
from gateway.nav import earth


class DepthSensor:
    """Depths and altitudes in their order; one out of the water feels no depth."""

    def __init__(self, on: Aboard[DepthModel]) -> None:
        self._on = on
        self._noise = on.draws()

    def say(self, t: Array) -> Iterator[tuple[Record, ...]]:
        """A depth at each of the times (n,) s, with the altitude over a bed."""
        on, model = self._on, self._on.model
        white = model.noise.depth_m * self._noise.standard_normal(t.size)
        r_e, _ = on.trajectory.point(t, model.lever_arm_m)
        h = np.asarray(earth.ecef_to_lla(r_e)[2])
        error = model.offset_m + white
        depths = np.maximum(on.scenario.surface_height_m - h + error, 0.0)
        told = on.told_unix_s(t) % 86_400.0
        felt = [
            DepthRecord(t_rx_ns=0, depth_m=depth_m, t_device_s=told_s)
            for depth_m, told_s in zip(depths.tolist(), told.tolist(), strict=True)
        ]
        altitudes = on.altitude_m(h)
        if altitudes is not None:
            above = np.maximum(altitudes + error, 0.0).tolist()
            felt = [replace(r, altitude_m=a) for r, a in zip(felt, above, strict=True)]
        yield from ((record,) for record in felt)
