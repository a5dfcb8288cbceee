"""An array's measurements as sentences in its own format, in the order they leave it."""

from bisect import bisect_left
from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import Literal

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace
from numpy.typing import NDArray

from drivers import registry
from drivers.records import Record, TimeDifference, UsblRecord
from gateway.emulator.acoustics.array import Fixes, Listening, acoustic_errors
from gateway.emulator.acoustics.timing import latencies, shown, timeout_s
from gateway.emulator.acoustics.topside import Sightings, sightings
from gateway.emulator.scenario import LblModel, Message, Scenario, UsblModel, codec_options
from gateway.emulator.streams import Draws, Emission
from gateway.emulator.trajectory import Trajectory

Array = NDArray[np.float64]
Timed = tuple[float, UsblRecord]
"""When its first byte leaves (s), and what it says."""

_BLOCK_PINGS = 16
"""So many are computed at once: ten milliseconds or so, whatever the scenario's length."""


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
) -> Iterator[Timed]:
    """What the array says until the scenario ends, by the time at which it leaves (s)."""
    draws = Draws(scenario.seed, name)
    error_s = acoustic_errors(scenario, name, model).latency
    waiting: list[Timed] = []
    for fixes, t_settled in Listening(scenario, name, model, trajectory).blocks(_BLOCK_PINGS):
        seen = sightings(scenario, draws, model, trajectory, fixes)
        told_s = shown(scenario, name, model.time, fixes.t_rx, start_unix_s)
        heard = Heard(model, scenario.sound_speed_m_s, fixes, seen, told_s)
        late = latencies(draws, model, len(fixes.beacon), error_s)
        waiting += _about_replies(model, fixes, heard, late)
        if model.no_reply is not None:
            wait_s = timeout_s(model, scenario.sound_speed_m_s) + 1e-3 * model.clock.latency_ms
            asked = np.array([t for t, _ in fixes.unanswered])
            told_s = shown(scenario, name, model.time, asked, start_unix_s)
            for (t, beacon), t_told_s in zip(fixes.unanswered, told_s, strict=True):
                waiting.append((t + wait_s, heard.nothing(beacon, t_told_s)))
        waiting.sort(key=itemgetter(0))
        settled = bisect_left(waiting, t_settled, key=itemgetter(0))
        yield from (timed for timed in waiting[:settled] if timed[0] <= scenario.duration_s)
        del waiting[:settled]


def _about_replies(model: UsblModel, fixes: Fixes, heard: "Heard", late: Array) -> Iterator[Timed]:
    """All messages; where there is no fix, only the rate."""
    for k, t_rx in enumerate(fixes.t_rx.tolist()):
        t_out = t_rx + float(late[k])
        lost = any(begin <= t_rx < end for begin, end in model.no_fix_s)
        for message in model.says:
            if message == "rate":
                yield t_out, heard.say(message, k)
            elif not lost:
                yield t_out + 1e-3 * model.age_ms, heard.say(message, k)


def sentence_writer(model: UsblModel | LblModel) -> Callable[[Record], bytes]:
    """The device's ``encode`` with its options bound."""
    codec, options = registry.lookup(model.codec), codec_options(model)
    return lambda record: codec.encode(record, options)


class Heard:
    """What an instrument knows of the replies it heard, message by message."""

    def __init__(
        self,
        model: UsblModel,
        sound_speed: float,
        fixes: Fixes,
        seen: Sightings,
        t_told_s: list[float],
    ) -> None:
        self._model = model
        self._sound_speed = sound_speed
        self._fixes = fixes
        self._seen = seen
        self._t_told_s = t_told_s

    def say(self, message: Message, k: int) -> UsblRecord:
        """One message about the ``k``-th reply."""
        age_s = 1e-3 * self._model.age_ms
        told = UsblRecord(
            t_rx_ns=0,
            beacon=self._fixes.beacon[k],
            t_device_s=self._t_told_s[k],
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

    def nothing(self, beacon: str, t_told_s: float) -> UsblRecord:
        """That a beacon did not answer, and when it was asked."""
        return UsblRecord(
            t_rx_ns=0,
            beacon=beacon,
            t_device_s=t_told_s,
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
