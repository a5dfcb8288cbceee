"""Instruments: wire formats (sans-I/O codecs) and the links that carry their bytes."""
