"""Zenoh, which is imported only here: publication under ``usblnav/<vehicle>/``, and hearing it."""

from gateway.outputs.zenoh.client import ask, at, client_of, open_subscription
from gateway.outputs.zenoh.publisher import ZenohPublisher, open_publisher
from gateway.outputs.zenoh.settings import DEFAULT_ENDPOINT

__all__ = [
    "DEFAULT_ENDPOINT",
    "ZenohPublisher",
    "ask",
    "at",
    "client_of",
    "open_publisher",
    "open_subscription",
]
