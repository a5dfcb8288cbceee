"""The Doppler log: its velocity over a flat bed, in its own axes."""

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.records import DepthRecord, DvlRecord, HeadingRecord, Record, TimeRecord
from gateway.emulator.aiding.sensing import Aboard, Array
from gateway.emulator.scenario import DvlModel
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler


class DopplerLog:
    """Pings in their order."""

    def __init__(self, on: Aboard[DvlModel]) -> None:
        self._on = on
        self._noise = on.draws()
        errors = on.model.errors
        off = Rotation.from_rotvec(errors.mounting_deg, degrees=True).as_matrix()
        self._C_bs = off @ C_from_euler(*np.deg2rad(on.model.mounting_deg))
        self._gain = (1.0 + errors.scale) / on.model.scale

    def say(self, t: Array) -> Iterator[tuple[Record, ...]]:
        """One ping at each of the times (n,) s; in PD6 it is several lines."""
        on, model = self._on, self._on.model
        white = self._noise.standard_normal((t.size, 3)) * model.noise.velocity_m_s
        r_e, v_e = on.trajectory.point(t, model.lever_arm_m)
        C_eb = on.trajectory.pose(t).C_eb
        v_s = np.einsum("nij,ni->nj", C_eb @ self._C_bs, v_e)
        altitude = on.altitude_m(np.asarray(earth.ecef_to_lla(r_e)[2]))
        assert altitude is not None
        pings = zip(
            (self._gain * v_s + white).tolist(),
            altitude.tolist(),
            on.told_unix_s(t).tolist(),
            strict=True,
        )
        for k, (velocity, altitude_m, unix_s) in enumerate(pings):
            ping = self._ping(velocity, altitude_m, unix_s)
            yield (ping,) if model.codec != "pd6" else self._lines(ping, t[k : k + 1])

    def _ping(self, velocity: list[float], altitude_m: float, unix_s: float) -> DvlRecord:
        model = self._on.model
        low, high = model.altitude_limits_m
        x, y, z = velocity
        locked = low <= altitude_m <= high and math.hypot(x, y, z) <= model.max_speed_m_s
        return DvlRecord(
            t_rx_ns=0,
            age_s=1e-3 * model.age_ms,
            velocity_m_s=(x, y, z) if locked else None,
            t_device_s=unix_s,
            valid=locked,
            altitude_m=altitude_m if locked else None,
            sd_m_s=model.noise.velocity_m_s,
            sound_speed_m_s=self._on.scenario.sound_speed_m_s,
        )

    def _lines(self, ping: DvlRecord, t: Array) -> tuple[Record, ...]:
        """Attitude, time, velocity and range, as PD6 has them."""
        g = self._on.trajectory.geodetic(t)
        roll, pitch, heading = (float(np.rad2deg(a[0])) for a in (g.roll, g.pitch, g.heading))
        return (
            HeadingRecord(t_rx_ns=0, heading_deg=heading % 360.0, roll_deg=roll, pitch_deg=pitch),
            TimeRecord(t_rx_ns=0, unix_s=ping.t_device_s),
            ping,
            DepthRecord(t_rx_ns=0, altitude_m=ping.altitude_m or 0.0),
        )
