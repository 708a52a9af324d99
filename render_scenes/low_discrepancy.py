"""Additive recurrences that spread points evenly over a unit cube of any dimension (Roberts, 2018)."""

from __future__ import annotations

from functools import cache


@cache
def additive_steps(dimensions: int) -> tuple[float, ...]:
    """Steps 1/g, 1/g^2, ... of the fractional coordinates, with g the positive root of x^(dimensions + 1) = x + 1."""
    root = 2.0
    while (closer := (1.0 + root) ** (1.0 / (dimensions + 1))) < root:
        root = closer
    return tuple(root**-number for number in range(1, dimensions + 1))
