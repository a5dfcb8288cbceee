"""The hardware-in-the-loop emulator: true motion as real frames on real wires."""
