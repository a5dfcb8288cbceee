"""How the hot functions are compiled: to machine code, cached on disk, typed as what they are."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

_Fn = TypeVar("_Fn", bound=Callable[..., object])


def compiled(function: _Fn) -> _Fn:
    """Compile on first call, or take it from the cache (``NUMBA_CACHE_DIR``).

    Division by zero gives inf or NaN as in numpy. ``NUMBA_DISABLE_JIT=1`` runs the function itself.
    """
    return cast(_Fn, numba.njit(cache=True, error_model="numpy")(function))
