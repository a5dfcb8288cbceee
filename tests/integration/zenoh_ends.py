"""Sessions of somebody else's program, in this process, and how to wait for what they see."""

import asyncio
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Self

import zenoh


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


class Wire:
    """A way to an endpoint that can be cut: then it swallows all and says nothing."""

    def __init__(self, far: str) -> None:
        self._far = int(far.rpartition(":")[2])
        self._whole = asyncio.Event()
        self._whole.set()
        self.endpoint = ""

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._carry, "127.0.0.1", 0)
        self.endpoint = f"tcp/127.0.0.1:{self._server.sockets[0].getsockname()[1]}"
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()

    def cut(self) -> None:
        """Nothing gets through any more, either way."""
        self._whole.clear()

    def mend(self) -> None:
        """What was under way arrives."""
        self._whole.set()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._far)
        async with asyncio.TaskGroup() as group:
            group.create_task(self._pass(reader, back))
            group.create_task(self._pass(there, writer))

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            while data := await reader.read(65536):
                await self._whole.wait()
                writer.write(data)
        writer.close()
