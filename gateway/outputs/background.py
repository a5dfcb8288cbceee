"""Blocking calls that nobody has to wait for: not the event loop, not the end of the program."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from typing import TypeVar

T = TypeVar("T")

NAME = "usblnav-background"
"""Of the threads; `gateway.__main__` does not let the interpreter end under them."""


def _forget(_: object) -> None:
    pass


async def in_thread(
    call: Callable[[], T], error: type[Exception], late: Callable[[T], None] = _forget
) -> T:
    """Await a blocking call in a daemon thread of its own.

    The loop's executor will not do: the program ends only when its threads have, and a name
    server or a router that is silent keeps them for many seconds.

    Parameters
    ----------
    call
        What to do there.
    error
        What `call` raises when it fails; raised here too.
    late
        Gets the result where the waiting was cancelled meanwhile.
    """
    done: Future[T] = Future()

    def work() -> None:
        try:
            result = call()
        except error as failure:
            with suppress(InvalidStateError):
                done.set_exception(failure)
        else:
            try:
                done.set_result(result)
            except InvalidStateError:
                late(result)

    threading.Thread(target=work, name=NAME, daemon=True).start()
    return await asyncio.wrap_future(done)
