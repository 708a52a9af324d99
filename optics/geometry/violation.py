"""Violations of a spec that no layout meets, for the mirrors with the smallest violation."""

from __future__ import annotations

from typing import Annotated

from mirrorcam.core.values import FloatArray, Shaped, Value
from mirrorcam.optics.geometry.mirror import Mirror

Segment = Annotated[FloatArray, Shaped((2, 3))]


class Violation(Value):
    """A limit that a mirror, or a pair of mirrors, violates.

    Attributes
    ----------
    mirrors : one or two indices.
    missing_mm : amount by which the limit is violated; for an overlap, the distance by which a mirror would have to be
        extended.
    place_in_rig_mm : ends (2, 3) of the segment to draw. It connects the closest points of two solids, or of a solid
        and the camera's box (equal if these meet); or it is an edge that is too short; the line from a corner back to
        the depth that it exceeds; or the line from a mirror's edge to the reflection of a corner of the region.
    """

    mirrors: tuple[int, ...]
    missing_mm: float
    place_in_rig_mm: Segment


class LeastViolation(Value):
    """The mirrors with the smallest violation of a spec that the search found.

    Attributes
    ----------
    constraint : the most violated constraint, as named by `InfeasibleDesign`.
    mirrors : mirrors in the order of a layout, in the rig frame, mm. Their sub-images may overlap, which a `Layout`
        forbids.
    violations : violations of that constraint, worst first.
    """

    constraint: str
    mirrors: tuple[Mirror, ...]
    violations: tuple[Violation, ...]
