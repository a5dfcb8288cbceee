"""Captures and recordings through the daemon's pipeline, into files, as fast as the machine can."""

from gateway.replay.pipeline import run

__all__ = ["run"]
