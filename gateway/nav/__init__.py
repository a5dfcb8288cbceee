"""The Earth, rotations and the strapdown: mathematics without I/O or clocks."""
