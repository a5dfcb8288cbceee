"""The demo: an emulated vehicle, the real daemon beside it, and a viewer that hears both."""

from gateway.demo.show import run

__all__ = ["run"]
