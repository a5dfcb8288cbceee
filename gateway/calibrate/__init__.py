"""From a replay to the numbers a survey crew wants: how the array sits, its scale, its latency."""

from gateway.calibrate.findings import Findings, find
from gateway.calibrate.source import Source, read

__all__ = ["Findings", "Source", "find", "read"]
