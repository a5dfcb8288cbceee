"""Sessions of somebody else's program, in this process, and how to wait for what they see."""

import asyncio
import json
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh


def free_endpoint(protocol: str = "tcp") -> str:
    """Where nobody listens yet."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def session(connect: str, mode: str = "client", **transport: Any) -> Iterator[zenoh.Session]:
    """A session with what listens at an endpoint; ``transport`` in Zenoh's own words."""
    settings = {
        "mode": mode,
        "connect": {"endpoints": [connect]},
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}},
        "transport": transport,
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as opened:
        yield opened


async def until(condition: Callable[[], object], do: Callable[[], object] = lambda: None) -> None:
    """Wait for a condition, doing something again and again meanwhile."""
    for _ in range(400):
        if condition():
            return
        do()
        await asyncio.sleep(0.05)
    pytest.fail("waited twenty seconds in vain")
