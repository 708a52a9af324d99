"""Compile loops over pixels to machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function at its first call, and cache the code next to the source or in the user's cache.

    The code releases the interpreter's lock, so threads run in parallel, and rounds as written: the results are
    identical on every processor. Division by zero gives infinity or NaN, as in NumPy.

    Three habits keep the first call short: fill slices from arrays by loops, since an assignment compiles the
    formatting of its error; allocate work arrays by NumPy; begin with np.int64(0) a count that is passed on, since a
    literal is another type, for which the callee is compiled once more.
    """
    code: Callable[..., Any] = njit(nogil=True, cache=True, error_model="numpy")(function)
    return code


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function as `compiled` does, inlined into its callers.

    For functions called for each pixel with many arguments, where passing an array costs more than the arithmetic.
    """
    code: Callable[..., Any] = njit(nogil=True, cache=True, error_model="numpy", forceinline=True)(function)
    return code
