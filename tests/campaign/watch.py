"""Where each record of a device lay in its bytes: whether all of them became something."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from drivers.codec import Decoder
from drivers.records import Record, Rejected
from gateway.emulator.streams import Emission, Fate


class WatchedDecoder:
    """A device's decoder, with notes of where its records begin.

    Every chunk must have a receive stamp of its own: it tells which chunk a record began in.
    """

    def __init__(self, make: Callable[[], Decoder]) -> None:
        self.make = make
        self._decoder = make()
        self._ends: dict[int, int] = {}
        self.data = bytearray()
        self.found: list[tuple[int, int | None]] = []
        """Offset of each record; how long it is if it is rejected bytes."""

    def feed(self, data: bytes, t_rx_ns: int) -> Iterator[Record | Rejected]:
        self.data += data
        assert t_rx_ns not in self._ends
        self._ends[t_rx_ns] = len(self.data)
        for record in self._decoder.feed(data, t_rx_ns):
            self._note(record)
            yield record

    def close(self) -> Iterator[Record | Rejected]:
        for record in self._decoder.close():
            self._note(record)
            yield record

    def _note(self, record: Record | Rejected) -> None:
        start = self._ends[record.t_rx_ns] - record.line_bytes
        self.found.append((start, len(record.data) if isinstance(record, Rejected) else None))


@dataclass
class Units:
    """What left a device, unit by unit: where each began, what it is, the how manieth frame."""

    starts: list[int] = field(default_factory=list)
    fates: list[Fate] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    total: int = 0
    made: int = 0
    _within: bool = False

    def note(self, e: Emission) -> None:
        """Take the next bytes, or a frame that is lost."""
        if not self._within:
            self.made += e.fate in ("damaged", "dropped") or (e.fate == "whole" and bool(e.data))
            if e.data:
                self.starts.append(self.total)
                self.fates.append(e.fate)
                self.numbers.append(self.made)
        if e.data:
            self._within = not e.last
        self.total += len(e.data)


@dataclass(frozen=True)
class Verdict:
    """What became of the units of a device.

    Attributes
    ----------
    decoded
        Whole frames, repeated ones too, of which exactly a record was made.
    beside
        Whole frames lost because of what stood beside them: among the rejected bytes.
    taken
        Damaged frames, or junk, that were taken for good ones.
    made
        Frames that the device made from the first decoded to the last.
    faults
        What must not be: bytes that are in no record or in two.
    """

    decoded: int
    beside: int
    taken: int
    made: int
    faults: list[str]


def judge(name: str, units: Units, watched: WatchedDecoder) -> Verdict:
    """Lay the records over the units."""
    faults = []
    total = len(watched.data)
    if units.total != total:
        faults.append(f"{name}: {units.total} bytes sent, {total} taken")
    frames: list[tuple[int, int]] = []
    at, open_frame = 0, None
    for start, rejected in [*watched.found, (total, 0)]:
        if open_frame is not None and start > open_frame:
            frames.append((open_frame, start))
            at, open_frame = start, None
        if start != at:
            faults.append(f"{name}: a record begins at byte {start}, the one before ends at {at}")
        if rejected is None:
            at = open_frame = start
        else:
            at = start + rejected
    heard = dict(frames)
    ends = [*units.starts[1:], units.total]
    whole = decoded = 0
    good: list[int] = []
    for start, end, fate, number in zip(
        units.starts, ends, units.fates, units.numbers, strict=True
    ):
        if fate not in ("whole", "repeated"):
            continue
        whole += 1
        parts = []
        at = start
        while at in heard and at < end:  # some formats say one sample in two packets
            parts.append(at)
            at = heard[at]
        if at == end:
            decoded += 1
            good.append(number)
            for part in parts:
                del heard[part]
    for start, end in heard.items():
        alone = watched.make()
        found = [*alone.feed(bytes(watched.data[start:end]), 0), *alone.close()]
        if any(isinstance(record, Rejected) for record in found):
            faults.append(f"{name}: of bytes {start} to {end} some are in no record")
    made = max(good[-3:]) - min(good[:3]) + 1 if good else 0
    return Verdict(decoded, whole - decoded, len(heard), made, faults)
