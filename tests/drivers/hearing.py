"""A link's chunks, to be waited for one by one."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Self

from drivers.links import Chunk, Link, LinkCounts, open_link
from drivers.settings import Link as LinkSettings


class Heard:
    """What came; what was heard still comes before the loss."""

    link: Link

    def __init__(self) -> None:
        self._chunks: deque[Chunk] = deque()
        self._news = asyncio.Event()

    def take(self, chunk: Chunk) -> None:
        self._chunks.append(chunk)
        self._news.set()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Chunk:
        lost = asyncio.ensure_future(self.link.lost())
        try:
            while not self._chunks:
                self._news.clear()
                news = asyncio.ensure_future(self._news.wait())
                await asyncio.wait({lost, news}, return_when=asyncio.FIRST_COMPLETED)
                news.cancel()
                if lost.done() and not self._chunks:
                    lost.result()
        finally:
            lost.cancel()
        return self._chunks.popleft()


@asynccontextmanager
async def hearing(settings: LinkSettings, counts: LinkCounts | None = None) -> AsyncIterator[Heard]:
    """Open a link and keep what it hands over."""
    heard = Heard()
    async with open_link(settings, heard.take, counts) as heard.link:
        yield heard
