"""The number of used bits in 16-bit samples: cameras of 10, 12 or 14 bits store them in the lowest bits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

import numpy as np
from numpy.typing import NDArray

_USED = (8, 10, 12, 14, 16)
ALL = 16
_LINES = 256


@dataclass(frozen=True)
class SampleBits:
    """The largest of some samples, the bits set in any of them, and the number of significant bits that a file states.

    Without a stated number, the largest sample determines the used bits. A stated number (as sBIT of PNG) should refer
    to the highest bits, but some programs mean the lowest, which the samples show.
    """

    largest: int = 0
    set_bits: int = 0
    stated: int | None = None

    @classmethod
    def of(cls, samples: NDArray[Any], stated: int | None = None) -> SampleBits:
        """Return the bits of some 16-bit samples."""
        return cls(int(samples.max(initial=0)), int(np.bitwise_or.reduce(samples, axis=None)), stated)

    @classmethod
    def together(cls, some: Iterable[SampleBits]) -> SampleBits:
        """Return the bits of all pictures or frames of a set, which share one scale."""
        found = list(some)
        stated = {each.stated for each in found}
        return cls(
            max((each.largest for each in found), default=0),
            reduce(or_, (each.set_bits for each in found), 0),
            stated.pop() if len(stated) == 1 else None,
        )

    @property
    def used(self) -> int:
        """Number of used bits: 8, 10, 12, 14 or 16, or the stated number."""
        if self.stated is not None and self.stated >= 8:
            are_lowest = self.largest < 1 << self.stated and self.set_bits & ((1 << (ALL - self.stated)) - 1)
            return self.stated if are_lowest else ALL
        return next(bits for bits in _USED if self.largest < 1 << bits)

    def __str__(self) -> str:
        used = "all" if self.used == ALL else f"the lowest {self.used}"
        return (
            f"16 bits a channel, largest value {self.largest}: {used} of these bits are taken as used, and the highest "
            "8 of them are read"
        )


def to_8_bits(samples: NDArray[Any], bits: int) -> NDArray[np.uint8]:
    """Convert 16-bit samples, of which the lowest `bits` are used, to 8 bits."""
    scaled = np.empty(samples.shape, np.uint8)
    for begin in range(0, len(samples), _LINES):  # in blocks, because a large picture should not be in memory twice
        lines = slice(begin, begin + _LINES)
        scaled[lines] = np.minimum(samples[lines] >> (bits - 8), 255)
    return scaled
