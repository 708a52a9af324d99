"""Values of a design for the pages, computed by `drawing`. Cheap to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from mirrorcam.core.values import Value
from mirrorcam.optics.geometry.layout import Layout

Kind = Literal["exact", "preview", "parabola"]
"""Source of a drawing's mirrors: the optimiser, interpolation of similar designs, or facets of a paraboloid."""


class MirrorDrawing(Value):
    """One mirror: the corners (2n, 3) of its glass and its chief ray (3, 3) in view axes, mm; outlines (k, 2), px."""

    name: str
    solid_mm: list[list[float]]
    chief_mm: list[list[float]]
    outline_px: list[list[float]]
    usable_px: list[list[float]]


class ViewRays(Value):
    """Rays along the corners of each view's field, in view axes: points (m, 3), mm, directions (m, 3) with z = 1."""

    mirror: list[int]
    points_mm: list[list[float]]
    directions: list[list[float]]
    reach_mm: float


class Curves(Value):
    """Figures over depth; sigma is null if the views have no common field, and empty in a preview."""

    depths_mm: list[float]
    usable: list[float]
    disparity_px: list[float]
    resolution_mm: list[float]
    sigma_mm: list[float | None]


class FigureText(Value):
    """A metric formatted for display; if unknown, `value` is null and `reason` says why."""

    name: str
    label: str
    text: str
    value: float | None
    reason: str = ""
    limit: str = ""
    passed: bool = True
    lower_is_better: bool | None = True
    """None if neither is better."""


class DesignDrawing(Value):
    """Drawing of a design; lengths in view axes (x right, y down, z forward, origin at the pupil), mm."""

    kind: Kind
    title: str
    identity: str
    spec: dict[str, Any]
    depths_mm: list[float]
    view_from_rig: list[list[float]]
    sensor_px: tuple[int, int]
    body_mm: list[list[float]]
    mirrors: list[MirrorDrawing]
    rays: ViewRays
    common_px: list[list[list[list[float]]]]
    """Outline (k, 2), px, of the common region in each mirror, for each working depth."""
    centres_mm: list[list[float]]
    grid_mm: list[list[float]]
    neighbours: list[tuple[int, int]]
    central: int
    curves: Curves
    figures: dict[str, list[FigureText]]
    verdict: list[FigureText]


@dataclass(frozen=True)
class SolvedDesign:
    """A design with its figures, and its drawing."""

    layout: Layout
    drawing: DesignDrawing
    values: dict[str, float | None]
    """Means of the figures in `COMPARED`."""


class ViolationDrawing(Value):
    """The mirrors that violate a request least, and where; lengths in view axes, mm.

    `concerned` are the indices of mirrors that violate the constraint, `places_mm` the segments (2, 3) where they do
    so, worst first.
    """

    sensor_px: tuple[int, int]
    body_mm: list[list[float]]
    mirrors: list[MirrorDrawing]
    concerned: list[int]
    places_mm: list[list[list[float]]]


class SuggestedRequest(Value):
    """A feasible request near an infeasible one, and the difference in words."""

    text: str
    spec: dict[str, Any]


class Compared(Value):
    """Figures that compare designs of any counts and depths: the mean of those whose names begin with `start`."""

    start: str
    label: str
    unit: str
    lower_is_better: bool = True


COMPARED = (
    Compared(start="depth_sigma", label="\N{GREEK SMALL LETTER SIGMA} of depth", unit="mm"),
    Compared(start="usable_efficiency", label="usable pixels", unit="of all", lower_is_better=False),
    Compared(start="fov_x", label="field of view, x", unit="\N{DEGREE SIGN}", lower_is_better=False),
    Compared(start="baseline_x", label="baseline, x", unit="mm", lower_is_better=False),
    Compared(start="grid_error", label="grid error", unit="of a spacing"),
    Compared(start="device_price", label="price, with camera", unit="EUR"),
    Compared(start="device_size", label="size", unit="mm"),
    Compared(start="device_mass", label="mass, with camera", unit="g"),
    Compared(start="device_print", label="printing time", unit="h"),
    Compared(start="smallest_area", label="smallest mirror", unit="mm\N{SUPERSCRIPT TWO}", lower_is_better=False),
)


class DesignPoint(Value):
    """A solved design near a request: the fields that differ, and the means of the figures in `COMPARED`.

    `step` is the control that is one step away from the request; empty for designs farther away. `misses` are the kinds
    of the terms of a target that it misses, None without a target.
    """

    title: str
    changes: dict[str, Any]
    step: str
    values: dict[str, float | None]
    misses: list[str] | None = None


class Neighbourhood(Value):
    """Solved designs that are comparable with a request, and the number of those that are still to be solved."""

    points: list[DesignPoint]
    pending: int


@dataclass(frozen=True)
class RefusedDesign:
    """An infeasible request: the violated constraint, by how much, and where."""

    constraint: str
    finding: str
    drawing: ViolationDrawing | None = None


class FoundDesign(Value):
    """A design found for a target: its request, its figure for each term, and its mirrors and device in words."""

    title: str
    spec: dict[str, Any]
    terms: list[FigureText]
    mirrors: str
    device: str


@dataclass(frozen=True)
class TargetResult:
    """The designs that a search for a target found, or why there is none."""

    designs: tuple[FoundDesign, ...] = ()
    solved: tuple[SolvedDesign, ...] = ()
    refusal: str = ""


DesignResult = SolvedDesign | RefusedDesign
"""The result of a request."""


class ToleranceBar(Value):
    """One figure: of the design, and the range of 90 % of the devices with their median."""

    label: str
    design: float
    low: float
    median: float
    high: float
    text: str


class ToleranceBars(Value):
    """All figures of a study, and its assumptions."""

    assumed: str
    hidden: float
    bars: list[ToleranceBar]
