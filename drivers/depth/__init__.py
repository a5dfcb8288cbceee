"""Codecs of depth and pressure sensors."""
