"""Where a design that cannot be violates its spec, in the arrangement of mirrors that violates it least."""

from __future__ import annotations

from typing import Annotated

from mirrorcam.core.values import FloatArray, Shaped, Value
from mirrorcam.optics.geometry.mirror import Mirror

Segment = Annotated[FloatArray, Shaped((2, 3))]


class Violation(Value):
    """A limit that one mirror, or a pair of mirrors, misses.

    Attributes
    ----------
    mirrors : indices of the one or the two.
    missing_mm : by how much; of an overlap, how far a mirror would have to reach beyond its edge.
    place_in_rig_mm : ends (2, 3) of the segment to draw: between two solids, or a solid and the camera's box, where
        they are nearest to each other (one point where they meet), an edge that is too short, from a corner to the
        depth that it passes, or from the edge of a mirror to where a corner of the region is reflected.
    """

    mirrors: tuple[int, ...]
    missing_mm: float
    place_in_rig_mm: Segment


class LeastViolation(Value):
    """The arrangement with the least violation of a spec that the search has found.

    Attributes
    ----------
    constraint : that it violates most, as `InfeasibleDesign` names it.
    mirrors : in the order of a layout, in rig, mm. They need not be valid as a `Layout`: they may overlap as seen.
    violations : of that constraint, worst first.
    """

    constraint: str
    mirrors: tuple[Mirror, ...]
    violations: tuple[Violation, ...]
