"""Codecs of long-baseline acoustics."""
