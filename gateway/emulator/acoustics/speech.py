"""Whether a format can say what a scenario wants said, found out by saying it and reading it."""

from collections.abc import Iterable, Iterator

import numpy as np
from msgspec import UNSET

from drivers import registry
from drivers.records import LblRecord, LblReply, Record, UsblRecord
from gateway.emulator.acoustics.array import Fixes
from gateway.emulator.acoustics.sentences import Heard, pairs, sentence_writer
from gateway.emulator.acoustics.topside import Sightings
from gateway.emulator.scenario import LblModel, Scenario, UsblModel, codec_options

_SLANT_M, _DEPRESSION = 100.0, np.pi / 4

Samples = Iterable[tuple[str, Record]]
"""Messages with the beacon they are about."""


def faults(scenario: Scenario, name: str, model: UsblModel | LblModel) -> Iterator[str]:
    """What the device's format cannot say, each with its path in the file."""
    path = f"devices.{name}"
    wrong = _structure(scenario, model)
    if wrong is not None:
        yield f"{path}.{wrong}"
        return
    found = (_fault(model, beacon, record) for beacon, record in _samples(scenario, model))
    yield from dict.fromkeys(f"{path}.{fault}" for fault in found if fault is not None)


def _fault(model: UsblModel | LblModel, beacon: str, record: Record) -> str | None:
    """Why one message cannot be said, or is read otherwise than it was meant."""
    try:
        said = sentence_writer(model)(record)
    except ValueError as error:
        return f"codec: beacon {beacon}: {error}"
    decoder = registry.lookup(model.codec).decoder(codec_options(model))
    read = [*decoder.feed(said, 0), *decoder.close()][0]
    if isinstance(model, UsblModel) and isinstance(record, UsblRecord):
        if isinstance(read, UsblRecord):
            return _of_sighting(model, record, read)
    elif isinstance(record, LblRecord) and isinstance(read, LblRecord):
        meant, heard = ([reply.beacon for reply in each.replies] for each in (record, read))
        return None if heard == meant else f"codec: {model.codec} calls {meant} {heard}"
    return f"options: what {model.codec} says of beacon {beacon} is read as {type(read).__name__}"


def _structure(scenario: Scenario, model: UsblModel | LblModel) -> str | None:
    """Names of beacons and elements that are not there."""
    for k, beacon in enumerate(model.beacons):
        if beacon not in scenario.beacons:
            return f'beacons[{k}]: no beacon is called "{beacon}"'
    if isinstance(model, LblModel):
        asked = model.beacons or tuple(scenario.beacons)
        if model.rate_of is not None and model.rate_of not in asked:
            return f'rate_of: it asks no beacon called "{model.rate_of}"'
        return None
    compared = [k for pair in pairs(model) for k in pair]
    if "differences" in model.says and not compared:
        return "elements_m: missing; differences need two elements or more"
    if max(compared, default=0) > len(model.elements_m):
        return f"pairs: there are {len(model.elements_m)} elements in elements_m"
    return None


def _samples(scenario: Scenario, model: UsblModel | LblModel) -> Samples:
    if isinstance(model, LblModel):
        return _replies(scenario, model)
    return _sightings(scenario, model)


def _sightings(scenario: Scenario, model: UsblModel) -> Samples:
    """One of each message about each beacon."""
    names = list(model.beacons or scenario.beacons)
    n, one = len(names), np.ones(len(names))
    fixes = Fixes(
        t_tx=0.0 * one,
        t_rx=0.0 * one,
        beacon=names,
        bearing=0.0 * one,
        elevation=-_DEPRESSION * one,
        slant_range=_SLANT_M * one,
        arrival=np.zeros((n, len(model.elements_m))),
        range_rate=one,
        element_rates=np.ones((n, 1)),
        outlier=np.zeros(n, np.bool_),
        unanswered=[],
    )
    xyz = _SLANT_M * np.outer(one, [np.cos(_DEPRESSION), 0.0, np.sin(_DEPRESSION)])
    place = np.outer(one, [0.5, 1.0, 70.0]) if model.axes == "earth" else None
    seen = Sightings(fixes.bearing, fixes.elevation, xyz, place)
    heard = Heard(model, scenario.sound_speed_m_s, fixes, seen, [0.0] * n)
    for k, beacon in enumerate(names):
        for message in model.says:
            yield beacon, heard.say(message, k)
        if model.no_reply is not None:
            yield beacon, heard.nothing(beacon, 0.0)


def _replies(scenario: Scenario, model: LblModel) -> Samples:
    for beacon in model.beacons or scenario.beacons:
        reply = LblReply(beacon=beacon, one_way_s=0.5)
        t_ping_s = 0.0 if model.asks == "together" else None
        yield beacon, LblRecord(t_rx_ns=0, replies=(reply,), t_ping_s=t_ping_s)
    if model.rate_of is not None:
        rate = LblReply(beacon=model.rate_of, range_rate_m_s=1.0)
        yield model.rate_of, LblRecord(t_rx_ns=0, replies=(rate,))


def _of_sighting(model: UsblModel, said: UsblRecord, read: UsblRecord) -> str | None:
    codec = model.codec
    if read.beacon != said.beacon:
        return f'codec: {codec} calls beacon {said.beacon} "{read.beacon}"'
    if not said.valid:
        told = read.error_code
        return None if told == said.error_code else f"no_reply: {codec} says {told}"
    placed = read.lat_deg is not UNSET and read.bearing_deg is None
    axes = "earth" if placed else read.axes
    if axes != model.axes and said.range_rate_m_s is None:
        return f"axes: {codec} with these options says {axes}"
    if said.age_s is not UNSET and read.age_s is UNSET:
        return f"age_ms: {codec} tells no age; clock.latency_ms can hold it"
    return None
