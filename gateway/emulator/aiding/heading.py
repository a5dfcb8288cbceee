"""The compass: where its axis points, clockwise from north."""

from collections.abc import Iterator

import numpy as np

from drivers.records import HeadingRecord, Record
from gateway.emulator.aiding.sensing import Aboard, Array
from gateway.emulator.scenario import HeadingModel
from gateway.nav import earth
from gateway.nav.attitude import C_from_euler, euler_from_C


class Compass:
    """Headings in their order."""

    def __init__(self, on: Aboard[HeadingModel]) -> None:
        self._on = on
        self._noise = on.draws()
        self._C_bs = C_from_euler(*np.deg2rad(on.model.mounting_deg))

    def say(self, t: Array) -> Iterator[tuple[Record, ...]]:
        """A heading at each of the times (n,) s; PHINS tells attitude by a sentence of its own."""
        on, model = self._on, self._on.model
        white = model.noise.heading_deg * self._noise.standard_normal(t.size)
        pose = on.trajectory.pose(t)
        lat, lon, _ = earth.ecef_to_lla(pose.r_e)
        C_ns = np.swapaxes(earth.C_en(lat, lon), -1, -2) @ pose.C_eb @ self._C_bs
        roll, pitch, heading = np.rad2deg(euler_from_C(C_ns))
        said = (heading + model.offset_deg + white) % 360.0
        told = on.told_unix_s(t) % 86_400.0
        for row in zip(*(a.tolist() for a in (said, roll, pitch, told)), strict=True):
            yield self._sentences(*row)

    def _sentences(
        self, heading: float, roll: float, pitch: float, told_s: float
    ) -> tuple[Record, ...]:
        model = self._on.model
        t_device_s = told_s if model.clock.source == "device" else None
        if not model.attitude:
            return (HeadingRecord(t_rx_ns=0, heading_deg=heading, t_device_s=t_device_s),)
        if model.codec == "phins":
            attitude = HeadingRecord(t_rx_ns=0, roll_deg=roll, pitch_deg=pitch, valid=False)
            return HeadingRecord(t_rx_ns=0, heading_deg=heading), attitude
        record = HeadingRecord(
            t_rx_ns=0,
            heading_deg=heading,
            roll_deg=roll,
            pitch_deg=pitch,
            t_device_s=t_device_s,
        )
        return (record,)
