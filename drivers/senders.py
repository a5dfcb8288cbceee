"""A decoder for each sender of a line, so that the streams of two do not mix."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from drivers.codec import Decoder
from drivers.records import Record, Rejected

MOST_SENDERS = 16
"""Anybody can invent senders: beyond so many the one heard longest ago is let go."""


@dataclass(slots=True)
class SenderCounts:
    """What became of one sender's bytes."""

    bytes: int = 0
    records: int = 0
    rejected_bytes: int = 0


class Senders:
    """Bytes in by sender, records out: a frame is put together from the bytes of one sender only.

    Parameters
    ----------
    make
        Gives a fresh decoder.

    Attributes
    ----------
    counts
        By sender, the one heard last at the end.
    others
        The sum of those that were let go.
    """

    def __init__(self, make: Callable[[], Decoder]) -> None:
        self._make = make
        self._decoders: dict[str, Decoder] = {}
        self._last: str | None = None
        self.counts: dict[str, SenderCounts] = {}
        self.others = SenderCounts()

    def feed(self, data: bytes, t_rx_ns: int, source: str = "") -> Iterator[Record | Rejected]:
        """Take one chunk of a sender; give the records that it completes.

        Where it takes the place of a sender that is let go, what waited of that one comes first.
        """
        if source != self._last:
            yield from self._turn_to(source)
        counts = self.counts[source]
        counts.bytes += len(data)
        yield from _counted(self._decoders[source].feed(data, t_rx_ns), counts)

    def close(self) -> Iterator[Record | Rejected]:
        """End of all bytes: what waits of each sender."""
        for source, decoder in self._decoders.items():
            yield from _counted(decoder.close(), self.counts[source])

    def _turn_to(self, source: str) -> Iterator[Record | Rejected]:
        """Have a decoder for a sender, and it at the end of the row."""
        self._last = source
        decoder = self._decoders.pop(source, None)
        if decoder is None and len(self._decoders) == MOST_SENDERS:
            yield from self._let_go(next(iter(self._decoders)))
        self._decoders[source] = decoder or self._make()
        self.counts[source] = self.counts.pop(source, SenderCounts())

    def _let_go(self, source: str) -> Iterator[Record | Rejected]:
        counts = self.counts.pop(source)
        yield from _counted(self._decoders.pop(source).close(), counts)
        self.others.bytes += counts.bytes
        self.others.records += counts.records
        self.others.rejected_bytes += counts.rejected_bytes


def _counted(
    records: Iterable[Record | Rejected], counts: SenderCounts
) -> Iterator[Record | Rejected]:
    for record in records:
        if type(record) is Rejected:
            counts.rejected_bytes += len(record.data)
        else:
            counts.records += 1
        yield record
