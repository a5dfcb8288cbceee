"""Captures of network traffic (pcap, pcapng) as the bytes that each device sent."""

from drivers.capture.files import CaptureError, Packet
from drivers.capture.reader import read_packets
from drivers.capture.streams import CaptureCounts, read_streams
from drivers.capture.tcpstream import StreamCounts

__all__ = [
    "CaptureCounts",
    "CaptureError",
    "Packet",
    "StreamCounts",
    "read_packets",
    "read_streams",
]
