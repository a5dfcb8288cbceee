"""A running gateway on a terminal: what it says over Zenoh, and what is not as it should be."""

from gateway.monitor.watch import watch

__all__ = ["watch"]
