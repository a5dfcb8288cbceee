"""Packets of a capture, whatever its file format."""

from collections.abc import Callable, Iterator
from pathlib import Path

from drivers.capture import pcapng
from drivers.capture.files import Packet, Source
from drivers.capture.pcap import MAGICS, pcap_packets
from drivers.capture.pcapng import pcapng_packets

_MAGIC_BYTES = 4


def read_packets(path: Path, told: Callable[[int], object] | None = None) -> Iterator[Packet]:
    """Packets of a pcap or pcapng file, gzipped or not, one after the other in constant memory.

    Parameters
    ----------
    told
        As `Source` has it: for who wants to know how far the reading is.

    Raises
    ------
    CaptureError
        For a file that is absent, empty or no capture; for one cut off or damaged, after the good
        packets before that.
    """
    with Source(path, told) as source:
        block = b""
        while len(block) < _MAGIC_BYTES:
            longer = source.more(block)
            if longer is None:
                raise source.refused("too short for a capture" if block else "empty file")
            block = longer
        if block.startswith(pcapng.MAGIC):
            yield from pcapng_packets(source, block)
        elif block[:_MAGIC_BYTES] in MAGICS:
            yield from pcap_packets(source, block)
        else:
            raise source.refused("neither pcap nor pcapng")
