"""Sound between a moving vehicle and moored beacons, and the instruments that listen to it."""

from gateway.emulator.acoustics.array import AcousticErrors, Fixes, acoustic_errors, measure
from gateway.emulator.acoustics.longbaseline import Replies, interrogate, lbl_stream
from gateway.emulator.acoustics.sentences import sentence_writer, usbl_stream
from gateway.emulator.acoustics.speech import faults

__all__ = [
    "AcousticErrors",
    "Fixes",
    "Replies",
    "acoustic_errors",
    "faults",
    "interrogate",
    "lbl_stream",
    "measure",
    "sentence_writer",
    "usbl_stream",
]
