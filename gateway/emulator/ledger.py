"""What became of all that an instrument said."""

from dataclasses import dataclass

from gateway.emulator.streams import Emission


@dataclass(slots=True)
class Sent:
    """Totals of one device.

    Of the frames it made ``frames`` left whole, ``damaged`` ones otherwise, ``dropped`` ones never.
    ``repeated`` frames left once more, and ``junk_bytes`` that are none. ``unsayable`` fixes do not
    exist in the device's format, ``dropped_bytes`` found nobody who took them.
    """

    frames: int = 0
    unsayable: int = 0
    bytes: int = 0
    dropped_bytes: int = 0
    damaged: int = 0
    dropped: int = 0
    repeated: int = 0
    junk_bytes: int = 0

    def note(self, emission: Emission) -> None:
        """Count what an emission is."""
        self.bytes += len(emission.data)
        match emission.fate:
            case "whole" if not emission.data:
                self.unsayable += 1
            case "whole":
                self.frames += emission.last
            case "damaged":
                self.damaged += emission.last
            case "repeated":
                self.repeated += emission.last
            case "junk":
                self.junk_bytes += len(emission.data)
            case "dropped":
                self.dropped += 1
            case "unplugged" | "plugged":
                pass
