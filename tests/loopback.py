"""Ports of loopback that nobody uses now, and waiting for what comes over them."""

import asyncio
import socket
from collections.abc import Callable

import pytest


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM, address: str = "127.0.0.1") -> int:
    """A port that nobody uses now."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family, kind) as probe:
        probe.bind((address, 0))
        return int(probe.getsockname()[1])


def free_endpoint(protocol: str = "tcp") -> str:
    """Where nobody listens yet, in Zenoh's words."""
    return f"{protocol}/127.0.0.1:{free_port()}"


async def until(
    condition: Callable[[], object], do: Callable[[], object] = lambda: None, within_s: float = 20.0
) -> None:
    """Wait for a condition, doing something again and again meanwhile."""
    for _ in range(round(within_s / 0.02)):
        if condition():
            return
        do()
        await asyncio.sleep(0.02)
    pytest.fail(f"waited {within_s:g} seconds in vain")
