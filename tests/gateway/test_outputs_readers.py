"""Silence of real connections, as the kernel tells it."""

import logging
import socket
import sys
import time
from collections.abc import Iterator

import pytest

from gateway.outputs.readers import Readers, silence_s

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")
TICK_S = 0.02
"""How coarsely the kernel tells silence, and more."""


def place(address: tuple[str, int]) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class Wire:
    """A connection, our end and the other."""

    def __init__(self, host: str, family: socket.AddressFamily) -> None:
        with socket.create_server((host, 0), family=family) as server:
            self.other = socket.create_connection(server.getsockname()[:2])
            self.ours, _ = server.accept()
        self.ends = (place(self.ours.getsockname()), place(self.ours.getpeername()))

    def speak(self) -> None:
        self.other.send(b"x")
        assert self.ours.recv(10) == b"x"

    def close(self) -> None:
        self.other.close()
        self.ours.close()


@pytest.fixture(params=[("127.0.0.1", socket.AF_INET), ("::1", socket.AF_INET6)], ids="46")
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    try:
        made = Wire(*request.param)
    except OSError:
        pytest.skip("no such addresses here")
    yield made
    made.close()


def test_silence_is_counted_from_the_last_word(wire: Wire) -> None:

    def spoken() -> float:
        """When it was about to speak; its silence since is no longer than that ago."""
        before = time.monotonic()
        wire.speak()
        assert (silence_s(*wire.ends) or 0.0) <= time.monotonic() - before + TICK_S
        return before

    spoke = spoken()
    while (silence_s(*wire.ends) or 0.0) < 0.3:
        wire.ours.send(b"what we say does not count")
        time.sleep(0.01)
    assert time.monotonic() - spoke > 0.3 - TICK_S
    spoken()


@pytest.mark.parametrize("ends", [("127.0.0.1:1", "127.0.0.1:2"), ("junk", "1"), ("[::1]:x", "")])
def test_of_what_is_no_connection_nothing_is_known(ends: tuple[str, str]) -> None:
    assert silence_s(*ends) is None


def test_each_turn_is_said_once(wire: Wire, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    readers = Readers("zenoh peer", silent_s=0.2)
    far = wire.ends[1]

    def until_stalled(count: int) -> None:
        while readers.stalled != count:
            readers.look([wire.ends])

    wire.speak()
    readers.look([wire.ends])
    assert (readers.connected, readers.stalled) == (1, 0)
    until_stalled(1)
    readers.look([wire.ends])
    while readers.stalled:
        wire.speak()
        readers.look([wire.ends])
    until_stalled(1)
    readers.look([])
    assert (readers.connected, readers.stalled, readers.given_up) == (0, 0, 1)
    assert caplog.messages == [
        f"output zenoh peer: {far} does not read; what it misses is lost",
        f"output zenoh peer: {far} reads again",
        f"output zenoh peer: {far} does not read; what it misses is lost",
        f"output zenoh peer: {far} is given up",
    ]


def test_who_leaves_in_good_order_is_not_news(wire: Wire, caplog: pytest.LogCaptureFixture) -> None:
    readers = Readers("zenoh peer")
    readers.look([wire.ends])
    readers.look([])
    assert (readers.connected, readers.given_up, caplog.messages) == (0, 0, [])
