"""Aiding instruments: what a receiver, a depth sensor, a log and a compass say of the truth."""

from gateway.emulator.aiding.speech import aiding_faults, aiding_stream

__all__ = ["aiding_faults", "aiding_stream"]
