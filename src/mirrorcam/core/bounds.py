"""Ranges of numbers, shared by options and by values in files. Cheap to import, because help texts state them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Bounds:
    """A closed range of numbers, stated in the descriptions of fields."""

    min: float
    max: float
    text: str = ""

    def __str__(self) -> str:
        return self.text or f"{_plain(self.min)} to {_plain(self.max)}"

    def field(self, default: Any = ..., description: str = "", unset: str = "") -> Any:
        """Return a field for a number in this range, required without a default; `unset` describes the default None."""
        from pydantic import Field

        stated = f"{description}, {self}" if description else str(self)
        stated += f" [default: {unset}]" if unset else ""
        return Field(default=default, ge=self.min, le=self.max, description=stated)

    @property
    def limits(self) -> Any:
        """Constraint for each number of a tuple."""
        from pydantic import Field

        return Field(ge=self.min, le=self.max)

    def narrowed(self, min: float | None = None, max: float | None = None) -> Bounds:
        """Return this range with a different `min` or `max`."""
        return Bounds(self.min if min is None else min, self.max if max is None else max)


def _plain(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:.15g}"


LENGTH_MM = Bounds(0.001, 1e5)
SIDE_MM = LENGTH_MM.narrowed(min=20.0)
"""Largest sides of devices: a shorter length, as a term of a target, lacks its distance."""
GAP_MM = Bounds(0.0, 1e5)
"""Lengths that may be zero."""
OFFSET_MM = Bounds(-1e5, 1e5)
PART_MM = Bounds(0.001, 1e4)
"""Dimensions of parts of a device."""
PART_GAP_MM = PART_MM.narrowed(min=0.0)
PART_OFFSET_MM = PART_MM.narrowed(min=-PART_MM.max)
APERTURE_MM = Bounds(0.0, 1000.0)
PUPIL_WALK_MM = Bounds(-100.0, 100.0)
DEFOCUS_GROWTH_MM2 = Bounds(-1e6, 1e6)
DEPTH_MM = Bounds(0.001, 1e6)
DEPTH_OR_INF_MM = Bounds(0.001, math.inf, "0.001 to 1000000 or inf")
"""The text of `DepthOrInf`."""
AREA_MM2 = Bounds(0.0, 1e10)
TOLERANCE_MM = Bounds(0.0, 1000.0)
TOLERANCE_DEG = Bounds(0.0, 45.0)
SEED = Bounds(0, 2**63 - 1, "0 to 2^63 - 1")
WORKERS = Bounds(1, 1024)
SAMPLES_PER_PIXEL = Bounds(1, 65536)
PICTURES = Bounds(0, 100_000)
"""Pictures of a set; planning uses memory for each."""
GRID = Bounds(1, 1000)
"""Rows or columns of views."""
FOCAL_PX = Bounds(0.001, 1e7)
MIRRORS = Bounds(1, 12)
"""Rows or columns of mirrors."""
SENSOR_PX = Bounds(1, 65_535)
"""Width or height of a camera's pictures."""
FOLD_DEG = Bounds(60.0, 150.0)
PRINCIPAL_POINT_PX = Bounds(-1e7, 1e7)
REFRACTIVE_INDEX = Bounds(1.0, 4.0)
LINE_PX = Bounds(0, 65_535)
LARGEST_PICTURE_PX = 120_000_000
"""Pixels of the largest picture that is decoded: more than any camera's, and at most 0.8 GB of memory."""
LARGEST_PICTURE_SIDE_PX = 1_000_000
"""Largest width or height of a picture, as limited by PNG decoders."""
LARGEST_DISTORTION = 1e6
