"""A long baseline: one transducer asks several moored transponders how far they are."""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from drivers.records import LblRecord, LblReply
from gateway.emulator.acoustics.sentences import sentence_writer
from gateway.emulator.acoustics.timing import latencies, shown, timeout_s
from gateway.emulator.acoustics.water import Ear, Mask, moorings
from gateway.emulator.faults.sound import astray
from gateway.emulator.scenario import LblModel, Scenario
from gateway.emulator.streams import Draws, Emission, generator
from gateway.emulator.trajectory import Trajectory

Array = NDArray[np.float64]
Timed = tuple[float, LblRecord]
"""When its first byte leaves (s), and what it says."""


@dataclass(frozen=True, slots=True)
class LblConstants:
    """Constant errors of an interrogator: 1, (3,) m and s; the last two true less stated."""

    range_scale: float
    lever_arm: Array
    latency: float


@dataclass(frozen=True, slots=True)
class Replies:
    """What came back, one row a ping, one column a beacon.

    ``names`` of the beacons; ``t_ping`` (n,) s; of each reply (n, m) ``t_rx`` s when it was heard,
    ``one_way`` s as measured, ``range_rate`` m/s. ``asked``, ``heard``, ``outlier`` (n, m) bool.
    """

    names: list[str]
    t_ping: Array
    t_rx: Array
    one_way: Array
    range_rate: Array
    asked: Mask
    heard: Mask
    outlier: Mask


def lbl_constants(scenario: Scenario, name: str, model: LblModel) -> LblConstants:
    """Constant errors of a device: given in the scenario or drawn from its prior."""
    z = generator(scenario.seed, name, "constants").standard_normal(5)
    given, prior = model.errors, model.prior
    scale, lever, late_ms = given.range_scale, given.lever_arm_m, given.latency_ms
    return LblConstants(
        range_scale=float(prior.range_scale * z[0]) if scale is None else scale,
        lever_arm=prior.lever_arm_m * z[1:4] if lever is None else np.array(lever),
        latency=1e-3 * (float(prior.latency_ms * z[4]) if late_ms is None else late_ms),
    )


def interrogate(scenario: Scenario, name: str, model: LblModel, trajectory: Trajectory) -> Replies:
    """All replies of a scenario."""
    constants = lbl_constants(scenario, name, model)
    beacons = moorings(scenario, model.beacons)
    c = scenario.true_sound_speed_m_s or scenario.sound_speed_m_s
    ear = Ear(trajectory, np.array(model.lever_arm_m) + constants.lever_arm, c)
    t_ping = np.arange(0.0, scenario.duration_s, model.period_s)
    ways = [ear.ask(t_ping, model.period_s, beacon) for beacon in beacons]
    travel_time = np.stack([way.one_way for way in ways], axis=-1)
    rate = np.stack([ear.range_rate(way.t_rx, way.b_e, way.v_e) for way in ways], axis=-1)
    asked = np.ones(rate.shape, np.bool_)
    if model.asks == "in_turn":
        asked = np.arange(t_ping.size)[:, None] % len(beacons) == np.arange(len(beacons))

    rng = Draws(scenario.seed, name)
    outlier = rng("outlier").random(asked.shape) < model.outliers.probability
    outlier |= astray(scenario, name, t_ping, model.period_s, rng)[:, None]
    error_m = model.noise.range_m * rng("noise").standard_normal(asked.shape)
    longer = model.outliers.extra_range_m * rng("longer").standard_exponential(asked.shape)
    error_m += outlier * longer
    one_way = travel_time * (1.0 + constants.range_scale) + error_m / scenario.sound_speed_m_s
    near = (one_way > 0.0) & (one_way * scenario.sound_speed_m_s < model.max_range_m)
    t_rx = np.stack([way.t_rx for way in ways], axis=-1)
    answered = np.stack([way.answered for way in ways], axis=-1)
    answered &= t_rx - t_ping[:, None] <= timeout_s(model, scenario.sound_speed_m_s)
    answered &= rng("missed").random(asked.shape) >= model.missed_probability
    return Replies(
        names=[beacon.name for beacon in beacons],
        t_ping=t_ping,
        t_rx=t_rx,
        one_way=one_way,
        range_rate=rate + model.noise.range_rate_m_s * rng("rate").standard_normal(asked.shape),
        asked=asked,
        heard=asked & near & answered,
        outlier=outlier,
    )


def lbl_stream(
    scenario: Scenario, name: str, model: LblModel, trajectory: Trajectory, start_unix_s: float
) -> Iterator[Emission]:
    """Sentences of an interrogator in the order they leave it.

    A ping that nobody answered, where the format has no word for it, leaves no bytes.
    """
    encode = sentence_writer(model)
    for t_out, record in lbl_records(scenario, name, model, trajectory, start_unix_s):
        yield Emission(t_out, name, encode(record))


def lbl_records(
    scenario: Scenario, name: str, model: LblModel, trajectory: Trajectory, start_unix_s: float
) -> list[Timed]:
    """What it says until the scenario ends, by the time at which it leaves (s)."""
    replies = interrogate(scenario, name, model, trajectory)
    error_s = lbl_constants(scenario, name, model).latency
    late = latencies(Draws(scenario.seed, name), model, replies.t_ping.size, error_s)
    wait_s = timeout_s(model, scenario.sound_speed_m_s)
    said: list[Timed] = []
    told_s = shown(scenario, name, model.time, replies.t_ping, start_unix_s)
    for n, t_ping in enumerate(replies.t_ping.tolist()):
        heard = np.flatnonzero(replies.heard[n])
        ranges = tuple(
            LblReply(beacon=replies.names[m], one_way_s=float(replies.one_way[n, m])) for m in heard
        )
        if model.asks == "in_turn":
            at = zip(heard, ranges, strict=True)
            said += [(replies.t_rx[n, m] + late[n], _reply(reply)) for m, reply in at]
        else:
            complete = len(heard) == len(replies.names)
            t_told = replies.t_rx[n].max() if complete else t_ping + wait_s
            told = LblRecord(t_rx_ns=0, replies=ranges, t_ping_s=told_s[n])
            said.append((t_told + late[n], told))
        for m in heard:
            if replies.names[m] == model.rate_of:
                rate = LblReply(
                    beacon=replies.names[m], range_rate_m_s=float(replies.range_rate[n, m])
                )
                said.append((replies.t_rx[n, m] + late[n], _reply(rate)))
    return sorted(
        ((float(t), record) for t, record in said if t <= scenario.duration_s), key=itemgetter(0)
    )


def _reply(reply: LblReply) -> LblRecord:
    return LblRecord(t_rx_ns=0, replies=(reply,))
