"""How the hot functions are compiled: to machine code, cached on disk, typed as what they are."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, cast

import numba
from numba.core.event import Listener, install_listener

_Fn = TypeVar("_Fn", bound=Callable[..., object])


def compiled(function: _Fn) -> _Fn:
    """Compile on first call, or take it from the cache (``NUMBA_CACHE_DIR``).

    Division by zero gives inf or NaN as in numpy. ``NUMBA_DISABLE_JIT=1`` runs the function itself.
    """
    return cast(_Fn, numba.njit(cache=True, error_model="numpy")(function))


@contextmanager
def told_of_compiling(tell: Callable[[], object]) -> Iterator[None]:
    """Call `tell` once if within this context a function has to be compiled: half a minute of it.

    A cache that holds them all is silent.
    """
    with install_listener("numba:compile", _First(tell)):
        yield


class _First(Listener):
    """Calls a function at the first event."""

    def __init__(self, tell: Callable[[], object]) -> None:
        self._tell: Callable[[], object] | None = tell

    def on_start(self, event: Any) -> None:
        """Pass on the first."""
        tell, self._tell = self._tell, None
        if tell is not None:
            tell()

    def on_end(self, event: Any) -> None:
        """Let the end of it pass."""
