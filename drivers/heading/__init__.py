"""Codecs of compasses, gyrocompasses and attitude sensors."""
