"""An array's measurements as sentences in its own format, in the order they leave it."""

from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import Literal

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace

from drivers import registry
from drivers.records import Record, TimeDifference, UsblRecord
from gateway.emulator.acoustics.array import Fixes, acoustic_errors, measure
from gateway.emulator.acoustics.timing import latencies, shown
from gateway.emulator.acoustics.topside import Sightings, sightings
from gateway.emulator.scenario import LblModel, Message, Scenario, UsblModel, codec_options
from gateway.emulator.streams import Emission
from gateway.emulator.trajectory import Trajectory

Timed = tuple[float, UsblRecord]
"""When its first byte leaves (s), and what it says."""


def usbl_stream(
    scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory, start_unix_s: float
) -> Iterator[Emission]:
    """Sentences of an array in the order they leave it.

    ``Emission.t`` is when the first byte leaves: the latency after the reply. A fix that the format
    cannot say (LXT: a beacon above the array) is an emission without bytes.
    """
    encode = sentence_writer(model)
    for t_out, record in records(scenario, name, model, trajectory, start_unix_s):
        try:
            sentence = encode(record)
        except ValueError:
            sentence = b""
        yield Emission(t_out, name, sentence)


def records(
    scenario: Scenario, name: str, model: UsblModel, trajectory: Trajectory, start_unix_s: float
) -> list[Timed]:
    """What the array says until the scenario ends, by the time at which it leaves (s)."""
    fixes = measure(scenario, name, model, trajectory)
    seen = sightings(scenario, name, model, trajectory, fixes)
    heard = Heard(model, scenario.sound_speed_m_s, start_unix_s, fixes, seen)
    error_s = acoustic_errors(scenario, name, model).latency
    late = latencies(scenario.seed, name, model, len(fixes.beacon), error_s)
    said: list[Timed] = []
    for k, t_rx in enumerate(fixes.t_rx.tolist()):
        lost = any(begin <= t_rx < end for begin, end in model.no_fix_s)
        for message in model.says:
            if message == "rate":
                said.append((t_rx + late[k], heard.say(message, k)))
            elif not lost:
                said.append((t_rx + late[k] + 1e-3 * model.age_ms, heard.say(message, k)))
    if model.no_reply is not None:
        wait_s = timeout_s(model, scenario.sound_speed_m_s) + 1e-3 * model.clock.latency_ms
        said += [(t + wait_s, heard.nothing(t, beacon)) for t, beacon in fixes.unanswered]
    return sorted(
        ((float(t), record) for t, record in said if t <= scenario.duration_s), key=itemgetter(0)
    )


def sentence_writer(model: UsblModel | LblModel) -> Callable[[Record], bytes]:
    """The device's ``encode`` with its options bound."""
    codec, options = registry.lookup(model.codec), codec_options(model)
    return lambda record: codec.encode(record, options)


def timeout_s(model: UsblModel | LblModel, sound_speed: float) -> float:
    """How long a reply is waited for."""
    return model.timeout_s or 2.0 * model.max_range_m / sound_speed


class Heard:
    """What an instrument knows of the replies it heard, message by message."""

    def __init__(
        self,
        model: UsblModel,
        sound_speed: float,
        start_unix_s: float,
        fixes: Fixes,
        seen: Sightings,
    ) -> None:
        self._model = model
        self._sound_speed = sound_speed
        self._start = start_unix_s
        self._fixes = fixes
        self._seen = seen

    def say(self, message: Message, k: int) -> UsblRecord:
        """One message about the ``k``-th reply."""
        age_s = 1e-3 * self._model.age_ms
        told = UsblRecord(
            t_rx_ns=0,
            beacon=self._fixes.beacon[k],
            t_device_s=shown(self._model.time, float(self._fixes.t_rx[k]), self._start),
            axes=_axes(self._model),
            age_s=age_s if age_s and message != "rate" else UNSET,
        )
        match message:
            case "fix":
                return self._fix(told, k)
            case "angles":
                bearing_deg, elevation_deg = self._angles(k)
                return replace(told, bearing_deg=bearing_deg, elevation_deg=elevation_deg)
            case "differences":
                return replace(told, differences=self._differences(k))
            case "rate":
                return replace(told, range_rate_m_s=float(self._fixes.range_rate[k]))

    def nothing(self, t_ping: float, beacon: str) -> UsblRecord:
        """That a beacon did not answer."""
        return UsblRecord(
            t_rx_ns=0,
            beacon=beacon,
            t_device_s=shown(self._model.time, t_ping, self._start),
            valid=False,
            error_code=self._model.no_reply,
            axes=_axes(self._model),
        )

    def _fix(self, told: UsblRecord, k: int) -> UsblRecord:
        if self._seen.place is not None:
            lat, lon, depth_m = self._seen.place[k].tolist()
            lat_deg, lon_deg = float(np.rad2deg(lat)), float(np.rad2deg(lon))
            return replace(told, lat_deg=lat_deg, lon_deg=lon_deg, depth_m=depth_m)
        bearing_deg, elevation_deg = self._angles(k)
        slant_range_m = float(self._fixes.slant_range[k])
        x, y, z = self._seen.xyz[k].tolist()
        return replace(
            told,
            bearing_deg=bearing_deg,
            elevation_deg=elevation_deg,
            slant_range_m=slant_range_m,
            xyz_m=(x, y, z),
            one_way_s=slant_range_m / self._sound_speed,
        )

    def _angles(self, k: int) -> tuple[float, float]:
        bearing, elevation = self._seen.bearing[k], self._seen.elevation[k]
        return float(np.rad2deg(bearing)), float(np.rad2deg(elevation))

    def _differences(self, k: int) -> tuple[TimeDifference, ...]:
        arrival = self._fixes.arrival[k]
        return tuple(
            TimeDifference(
                element=str(i), than=str(j), delay_s=float(arrival[i - 1] - arrival[j - 1])
            )
            for i, j in pairs(self._model)
        )


def pairs(model: UsblModel) -> tuple[tuple[int, int], ...]:
    """Elements of the array that it compares."""
    last = len(model.elements_m)
    return model.pairs or tuple((k, last) for k in range(1, last))


def _axes(model: UsblModel) -> Literal["array", "level", "north"]:
    """A place on the Earth has no axes: such records leave them as they are."""
    return "array" if model.axes == "earth" else model.axes
