"""Loops over pixels as machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code, compiled when first called, then cached next to the source or in the user's cache.

    It holds no lock of the interpreter, so that threads run side by side, and rounds as written: the same bytes on
    every processor. Division by zero gives infinity or NaN, as in NumPy.
    """
    code: Callable[..., Any] = njit(nogil=True, cache=True, error_model="numpy")(function)
    return code


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as `compiled` makes it, copied into the machine code of each that calls it.

    For functions called for each pixel with many arguments, where passing an array costs more than the arithmetic.
    """
    code: Callable[..., Any] = njit(nogil=True, cache=True, error_model="numpy", forceinline=True)(function)
    return code
