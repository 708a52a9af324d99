"""The number of used bits in 16-bit samples: cameras of 10, 12 or 14 bits store them in the lowest bits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any

import numpy as np
from numpy.typing import NDArray

_DEPTHS = (8, 10, 12, 14, 16)
ALL = 16
_BLOCK_ROWS = 256


@dataclass(frozen=True)
class SampleBits:
    """The largest of some samples, the bits set in any of them, and the number of significant bits that a file states.

    Without a stated number, the largest sample determines the used bits. A stated number (such as sBIT of PNG) should
    refer to the highest bits, but some programs mean the lowest, which the samples show.
    """

    largest: int = 0
    set_bits: int = 0
    stated: int | None = None

    @classmethod
    def of(cls, samples: NDArray[Any], stated: int | None = None) -> SampleBits:
        """Return the bits of some 16-bit samples."""
        return cls(int(samples.max(initial=0)), int(np.bitwise_or.reduce(samples, axis=None)), stated)

    @classmethod
    def combined(cls, members: Iterable[SampleBits]) -> SampleBits:
        """Return the bits of all pictures or frames of a set, which share one scale."""
        parts = list(members)
        stated = {part.stated for part in parts}
        return cls(
            max((part.largest for part in parts), default=0),
            reduce(or_, (part.set_bits for part in parts), 0),
            stated.pop() if len(stated) == 1 else None,
        )

    @property
    def used(self) -> int:
        """Number of used bits: 8, 10, 12, 14 or 16, or the stated number."""
        if self.stated is not None and self.stated >= 8:
            are_lowest = self.largest < 1 << self.stated and self.set_bits & ((1 << (ALL - self.stated)) - 1)
            return self.stated if are_lowest else ALL
        return next(bits for bits in _DEPTHS if self.largest < 1 << bits)

    def __str__(self) -> str:
        used = "all" if self.used == ALL else f"the lowest {self.used}"
        return (
            f"16 bits a channel, largest value {self.largest}: {used} of these bits are taken as used, and the highest "
            "8 of them are read"
        )


def to_8_bits(samples: NDArray[Any], bits: int) -> NDArray[np.uint8]:
    """Convert 16-bit samples, of which the lowest `bits` are used, to 8 bits."""
    scaled = np.empty(samples.shape, np.uint8)
    for begin in range(0, len(samples), _BLOCK_ROWS):  # a large picture should not be in memory twice
        rows = slice(begin, begin + _BLOCK_ROWS)
        scaled[rows] = np.minimum(samples[rows] >> (bits - 8), 255)
    return scaled
