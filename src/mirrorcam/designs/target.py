"""What a designer asks of a device: terms such as "0.3mm@400mm" or "300g", and the figures that a design reaches."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.optimize import linprog
from shapely import Polygon
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.estimates import DeviceEstimate, estimate_device
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.bounds import DEPTH_MM, SIDE_MM
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric, Value
from mirrorcam.optics.design.assess.depth_sigma import DEPTH_UNKNOWN, mean_depth_sigma_mm
from mirrorcam.optics.geometry.design_spec import MAX_DEPTHS, box_corners
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import FieldsOfView, fields_of_view, vertices

Kind = Literal["depth_sigma", "field", "price", "parts_price", "mass", "print", "size"]

_NUMBER, _LENGTH = r"((?:\d+(?:\.\d+)?|\.\d+)(?:e[+-]?\d+)?)", "(um|mm|cm|m)"
_FORMS: dict[Kind, tuple[str, str]] = {
    "depth_sigma": (
        f"{_NUMBER}{_LENGTH}@{_NUMBER}{_LENGTH}",
        "0.3mm@400mm (standard deviation of depth at a distance)",
    ),
    "field": (
        f"{_NUMBER}x{_NUMBER}{_LENGTH}@{_NUMBER}{_LENGTH}",
        "150x120mm@400mm (width and height that all views show at a distance)",
    ),
    "price": (f"{_NUMBER}(EUR)", "90EUR (price with the camera)"),
    "parts_price": (rf"{_NUMBER}(EUR)\+camera", "60EUR+camera (price without the camera)"),
    "mass": (f"{_NUMBER}(kg|g)", "300g (mass with the camera)"),
    "print": (f"{_NUMBER}(h|min)", "8h (printing time)"),
    "size": (f"{_NUMBER}{_LENGTH}", "180mm (largest side of the device)"),
}
_UNITS = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "EUR": 1.0, "g": 1.0, "kg": 1000.0, "h": 1.0, "min": 1 / 60.0}
_UNIT_OF: dict[Kind, str] = {
    "depth_sigma": "mm",
    "field": "mm",
    "price": "EUR",
    "parts_price": "EUR",
    "mass": "g",
    "print": "h",
    "size": "mm",
}
MAX_EXCESS = 5.0
"""Excess of a figure that a design does not have."""


class Term(Value):
    """One requirement: a limit for a figure of a design.

    Attributes
    ----------
    kind : str
        `depth_sigma`: at most this standard deviation of depth, mm, at a distance. `field`: at least a rectangle of
        this width and height, mm, in the plane at a distance that all views see. `price` (EUR; `parts_price`: without
        the camera), `mass` (g), `print` (h), `size` (mm, the largest side): at most this, as `estimate_device` has it.
    limits : tuple of float
        The limit; width and height of a field.
    distance_mm : float or None
        Distance from the pupil along the views' axis, mm, of a standard deviation or a field.
    """

    kind: Kind
    limits: tuple[float, ...] = Field(min_length=1, max_length=2)
    distance_mm: float | None = DEPTH_MM.field(None)

    @classmethod
    def of(cls, text: str) -> Self:
        """Parse a term, such as "150x120mm@400mm"; raises InputError for anything else."""
        for kind, (pattern, _) in _FORMS.items():
            if match := re.fullmatch(pattern, text.strip()):
                groups = list(match.groups())
                distance_mm = None
                if kind in ("depth_sigma", "field"):
                    distance_mm = _UNITS[groups.pop()] * float(groups.pop(-1))
                unit = _UNITS[groups.pop()]
                return cls(kind=kind, limits=tuple(unit * float(group) for group in groups), distance_mm=distance_mm)
        raise InputError(f"target {text!r}: expected {', '.join(example for _, example in _FORMS.values())}")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.kind in ("depth_sigma", "field")) != (self.distance_mm is not None):
            raise ValueError(f"{self.kind} {'without' if self.distance_mm is None else 'with'} a distance")
        if len(self.limits) != (2 if self.kind == "field" else 1):
            raise ValueError(f"{self.kind} has {len(self.limits)} limits")
        if min(self.limits) <= 0.0:
            raise ValueError(f"{self.text} is not positive")
        if self.kind == "size" and self.limits[0] < SIDE_MM.min:
            raise ValueError(
                f"{self.text} is smaller than any device, expected {SIDE_MM.min:g}mm or more; a standard deviation of "
                f"depth needs its distance: {self.text}@400mm"
            )
        return self

    @property
    def text(self) -> str:
        """The term in the form that `of` reads."""
        at = "+camera" if self.kind == "parts_price" else ""
        at = at if self.distance_mm is None else f"@{_decimal(self.distance_mm)}mm"
        return f"{'x'.join(map(_decimal, self.limits))}{_UNIT_OF[self.kind]}{at}"

    def figure_text(self, value: float, error: float | None = None) -> str:
        """The text of a figure, such as "8.1 ± 0.2 h", or "162 x 130 mm" for a field of the width `value`."""
        if math.isnan(value):
            return "none"
        sides = [value * limit / self.limits[0] for limit in self.limits]
        texts = [f"{side:.3g}" if side < 100.0 else f"{side:.0f}" for side in sides]
        uncertain = "" if error is None else f" \N{PLUS-MINUS SIGN} {error:.2g}"
        return f"{' x '.join(texts)}{uncertain} {_UNIT_OF[self.kind]}"


def _decimal(number: float) -> str:
    """Six significant digits, without an exponent."""
    return np.format_float_positional(float(f"{number:.6g}"), trim="-")


class Target(Value):
    """Terms that a design shall meet, of which no two limit the same figure."""

    terms: tuple[Term, ...] = Field(min_length=1)

    @classmethod
    def of(cls, text: str | Sequence[str]) -> Self:
        """Parse terms, separated by spaces or commas in a text; raises InputError if one is unknown or given twice."""
        words = re.split(r"[\s,]+", text.strip()) if isinstance(text, str) else text
        return cls(terms=tuple(map(Term.of, words)))

    @model_validator(mode="after")
    def _check(self) -> Self:
        seen: dict[tuple[Kind, float | None], Term] = {}
        for term in self.terms:
            if (other := seen.setdefault((term.kind, term.distance_mm), term)) is not term:
                raise ValueError(f"{other.text} and {term.text} limit the same figure, expected one of them")
        if len(self.depths_mm) > MAX_DEPTHS:
            raise ValueError(f"{len(self.depths_mm)} distances, expected at most {MAX_DEPTHS}")
        return self

    @property
    def text(self) -> str:
        """All terms in the form that `of` reads."""
        return " ".join(term.text for term in self.terms)

    @property
    def depths_mm(self) -> tuple[float, ...]:
        """The distances of the terms in ascending order; empty if no term has one."""
        return tuple(sorted({term.distance_mm for term in self.terms if term.distance_mm is not None}))


class TargetDesign(Value):
    """A design and its figures for the terms of a target.

    Attributes
    ----------
    layout : Layout
        Nominal layout with its figures and its verdict.
    estimate : DeviceEstimate
        The device that it would make.
    reached : dict of str to Metric
        The figure of each term, by the term's text, with its limit. The figure of a field is the width of the largest
        rectangle of its proportions that all views see.
    """

    layout: Layout
    estimate: DeviceEstimate
    reached: dict[str, Metric]

    @property
    def log_size(self) -> float:
        """Logarithm of the geometric mean of the device's width, height and depth, mm."""
        return float(np.log(self.estimate.size_mm).mean())

    @property
    def excess(self) -> dict[str, float]:
        """The excess of each term: ln(figure / limit), or ln(limit / figure) for a field; at most 0 if it is met."""
        return {term: excess_of(metric) for term, metric in self.reached.items()}

    def figure_text(self, term: Term) -> str:
        """The text of the figure of a term, with the standard deviation of an estimate."""
        estimate = self.estimate
        errors: dict[Kind, float] = {
            "price": estimate.price_error_eur,
            "parts_price": estimate.price_error_eur,
            "mass": estimate.mass_error_g,
            "print": estimate.print_error_h,
            "size": estimate.size_error_mm,
        }
        return term.figure_text(self.reached[term.text].value, errors.get(term.kind))

    @property
    def meets(self) -> bool:
        """Whether all terms are met."""
        return not self.gives_way

    @property
    def gives_way(self) -> tuple[str, ...]:
        """The terms that are not met, the one that is missed most first."""
        missed = {term: excess for term, excess in self.excess.items() if excess > 0.0}
        return tuple(sorted(missed, key=lambda term: -missed[term]))


def excess_of(metric: Metric) -> float:
    """The logarithm of the ratio of a figure to its limit, positive if the limit is not met."""
    if not metric.known or metric.limit is None or metric.value <= 0.0:
        return MAX_EXCESS
    excess = math.log(metric.value / metric.limit)
    return float(np.clip(excess if metric.lower_is_better else -excess, -MAX_EXCESS, MAX_EXCESS))


def measure(layout: Layout, target: Target, hardware: Hardware = HARDWARE) -> TargetDesign:
    """The figures of a layout for a target; distances that are nearer than the device's front have none."""
    hardware = hardware.for_layout(layout)
    estimate = estimate_device(layout, hardware)
    views, unvignetted = fields_of_view(layout), fields_of_view(layout, layout.camera.pupil)
    device = {
        "price": estimate.price_eur,
        "parts_price": estimate.price_eur - estimate.camera_eur,
        "mass": estimate.mass_g,
        "print": estimate.print_h,
        "size": max(estimate.size_mm),
    }
    reached = {}
    for term in target.terms:
        if term.kind == "depth_sigma":
            metric = _depth_sigma(unvignetted, term)
        elif term.kind == "field":
            metric = _field(views, term)
        else:
            metric = Metric(value=device[term.kind], unit=_UNIT_OF[term.kind], limit=term.limits[0])
        reached[term.text] = metric
    return TargetDesign(layout=layout, estimate=estimate, reached=reached)


def front_mm(layout: Layout) -> float:
    """How far mirrors and camera reach in front of the pupil along the views' axis, mm."""
    body = [] if layout.camera.body_mm is None else [box_corners(*layout.camera.body_mm)]
    mirrors = (mirror.solid.corners_in_rig_mm for mirror in layout.mirrors)
    return float((np.vstack([*body, *mirrors]) @ layout.view_from_rig[2]).max())


def _depth_sigma(views: FieldsOfView, term: Term) -> Metric:
    assert term.distance_mm is not None
    is_nearer = term.distance_mm <= front_mm(views.layout)
    sigma = None if is_nearer else mean_depth_sigma_mm(views, term.distance_mm)
    if sigma is not None and math.isfinite(sigma):
        return Metric(value=sigma, unit="mm", limit=term.limits[0])
    reason = "this is nearer than the device" if is_nearer else "the views share no region there"
    return Metric(value=math.nan, unit="mm", limit=term.limits[0], reason=reason if sigma is None else DEPTH_UNKNOWN)


def _field(views: FieldsOfView, term: Term) -> Metric:
    assert term.distance_mm is not None
    is_nearer = term.distance_mm <= front_mm(views.layout)
    region = Polygon() if is_nearer else views.common_region(term.distance_mm)[0]
    factor = largest_factor(region, *term.limits)
    return Metric(value=factor * term.limits[0], unit="mm", limit=term.limits[0], lower_is_better=False)


def largest_factor(region: Polygon, width: float, height: float) -> float:
    """The largest factor by which an upright rectangle can be scaled so that a convex region contains it; 0 if empty.

    A linear program in the factor and the rectangle's centre: the support of the rectangle along the outward normal of
    every edge reaches at most to that edge.
    """
    if region.is_empty:
        return 0.0
    corners = vertices(orient(region.convex_hull))
    edges = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack([edges[:, 1], -edges[:, 0]])
    support = np.abs(outward) @ [width / 2.0, height / 2.0]
    offsets = (outward * corners).sum(axis=1)
    bounds = [(None, None), (None, None), (0.0, None)]
    solved = linprog([0.0, 0.0, -1.0], A_ub=np.column_stack([outward, support]), b_ub=offsets, bounds=bounds)
    return float(solved.x[2]) if solved.status == 0 else 0.0
