"""IP packets put together again from their fragments."""

from drivers.capture.packets import Content, Fragment, transport

MAX_WAITING = 64
MAX_WAIT_NS = 30_000_000_000

_Key = tuple[bytes, bytes, int, int]


class _Waiting:
    """The parts of one packet that have come so far."""

    def __init__(self, t_ns: int) -> None:
        self.t_ns = t_ns
        self.parts: dict[int, bytes] = {}
        self.size: int | None = None

    def whole(self) -> bytes | None:
        """The payload, once there is no gap in it."""
        if self.size is None:
            return None
        data = bytearray()
        for offset in sorted(self.parts):
            if offset > len(data):
                return None
            data += self.parts[offset][len(data) - offset :]
        return bytes(data[: self.size]) if len(data) >= self.size else None


class Fragments:
    """Bounded memory of unfinished packets.

    Attributes
    ----------
    abandoned
        Fragments given up, because the rest did not come in time.
    """

    def __init__(self) -> None:
        self.abandoned = 0
        self._waiting: dict[_Key, _Waiting] = {}

    def __len__(self) -> int:
        return sum(len(packet.parts) for packet in self._waiting.values())

    def add(self, fragment: Fragment, t_ns: int) -> Content | None:
        """Take one fragment; give the content of the packet that it completes."""
        self._forget(t_ns)
        key = (fragment.src, fragment.dst, fragment.protocol, fragment.identification)
        packet = self._waiting.setdefault(key, _Waiting(t_ns))
        packet.parts.setdefault(fragment.offset, fragment.payload)
        if not fragment.more:
            packet.size = fragment.offset + len(fragment.payload)
        data = packet.whole()
        if data is None:
            return None
        del self._waiting[key]
        return transport(fragment.protocol, fragment.src, fragment.dst, data)

    def _forget(self, t_ns: int) -> None:
        """Give up the oldest while there are too many or they have waited too long."""
        while self._waiting:
            key, oldest = next(iter(self._waiting.items()))
            if len(self._waiting) < MAX_WAITING and t_ns - oldest.t_ns <= MAX_WAIT_NS:
                return
            self.abandoned += len(oldest.parts)
            del self._waiting[key]
