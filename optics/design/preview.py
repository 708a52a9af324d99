"""Previews of designs: layouts at once, between those that were solved for specifications near by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.optimize import nnls
from shapely import STRtree

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.program.design_problem import REFERENCE_GRID_ERROR
from mirrorcam.optics.design.program.seeds import layout_of, mirrors_of, sensor_bounds, sensor_rectangle
from mirrorcam.optics.design.search import seed_meeting
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import fields_of_view, sensor_polygon

CHANGES = {
    "scale_mm": 0.25,
    "fold_deg": 2.5,
    "depths_mm": 0.12,
    "spacing_mm": 0.004,
    "seen_gap_mm": 0.004,
    "thickness_mm": 0.05,
    "tradeoff": 0.06,
    "camera": 0.025,
    "aperture_mm": 0.01,
    "body_clearance_mm": 0.1,
    "min_edge_mm": 0.1,
    "min_area_mm2": 0.1,
    "robust_tilt_deg": 0.1,
    "robust_offset_mm": 0.002,
}
"""Changes that cost about 0.01 of the sensor where mirrors do not follow: relative ones of scale, depths and sensor,
of fold and tilts in degrees, of lengths in scales, of areas in squared scales."""

SIDES = ("left", "top", "right", "bottom")

LOCAL = 0.03
"""Weight of the distances of the designs that are mixed, relative to the distance between mixture and specification."""

LEAST_WEIGHT = 0.02
"""Relative weight below which a design does not count."""

WORSE = 0.03
"""By how much the objective of a mixture may be worse than that of its parts, which have optima of one kind then."""

MOST_ROUNDS, SHRINKING, ON_SENSOR = 10, 0.99, 1e-6
"""Rounds in which sub-images that overlap or leave the sensor shrink by this factor; what is no leaving, normalized."""


def differences(spec: DesignSpec, other: DesignSpec) -> dict[str, float] | None:
    """How far `other` is from `spec` in each parameter, in multiples of `CHANGES`, with signs; only what differs.

    Each depth counts on its own, as "depths_mm 0", and so does each border of the sensor in normalized coordinates, as
    "camera left". A fold to be chosen differs from none. Returns None where counts, pattern, sides, surface, the number
    of depths, objective or lens model differ: no design of one is a preview of the other.
    """
    if _structure(spec) != _structure(other):
        return None
    scale_mm = float(np.sqrt(spec.scale_mm * other.scale_mm))
    found = {"scale_mm": float(np.log(other.scale_mm / spec.scale_mm))}
    if "auto" not in (spec.fold_deg, other.fold_deg):
        found["fold_deg"] = float(other.fold_deg) - float(spec.fold_deg)
    for k, (depth, another) in enumerate(zip(spec.depths_mm, other.depths_mm, strict=True)):
        found[f"depths_mm {k}"] = float(np.log(another / depth))
    lengths = ("spacing_mm", "seen_gap_mm", "thickness_mm", "body_clearance_mm", "min_edge_mm", "robust_offset_mm")
    found |= {name: (getattr(other, name) - getattr(spec, name)) / scale_mm for name in lengths}
    found["min_area_mm2"] = (other.min_area_mm2 - spec.min_area_mm2) / scale_mm**2
    found |= {name: getattr(other, name) - getattr(spec, name) for name in ("tradeoff", "robust_tilt_deg")}
    found["aperture_mm"] = (other.camera.aperture_mm - spec.camera.aperture_mm) / scale_mm
    if other.camera != spec.camera:
        borders, others = sensor_bounds(spec.camera), sensor_bounds(other.camera)
        moved = (others - borders) / (borders[1] - borders[0])
        found |= {f"camera {side}": float(by) for side, by in zip(SIDES, moved.ravel(), strict=True)}
    in_units = {name: by / CHANGES[name.partition(" ")[0]] for name, by in found.items()}
    return {name: by for name, by in in_units.items() if by != 0.0}


def _structure(spec: DesignSpec) -> tuple[object, ...]:
    shape = (spec.arrangement.rows, spec.arrangement.cols, spec.pattern, spec.sides, spec.surface)
    return (*shape, len(spec.depths_mm), spec.objective, spec.camera.lens_model)


def preview(spec: DesignSpec, solved: Sequence[Layout]) -> Layout | None:
    """What the design of a spec is about to look like, in milliseconds, from designs of other specs.

    Virtual centres and corners of sub-images are those of the mixture of designs whose spec comes nearest: where the
    spec lies between two of them, linear interpolation; beyond all, the nearest. The nearest design alone is taken
    where optima of two kinds do not mix. Scale, fold and sensor are those of the spec, and
    virtual centres follow the seed of the search with scale, depths and camera. Sub-images that would overlap or leave
    the sensor shrink. Nothing is optimised; gaps and light are not checked.

    Parameters
    ----------
    spec
        The requested design. A fold to be chosen is that of the nearest design.
    solved
        Designs with their specs; those of another structure (see `differences`) do not count.

    Returns
    -------
    Layout
        Nominal, without figures and verdict; its provenance states that it is a preview. None where no design counts,
        or where shrinking does not keep the sub-images apart.
    """
    near = [(layout, apart) for layout in solved if (apart := _apart(layout, spec)) is not None]
    near.sort(key=lambda pair: _length(pair[1]))
    if not near:
        return None
    if spec.fold_deg == "auto":
        spec = spec.replaced(fold_deg=_spec_of(near[0][0]).fold_deg)
    weights = _mixture([apart for _, apart in near])
    parts = [(layout, weight) for (layout, _), weight in zip(near, weights, strict=True) if weight]
    if len(parts) > 1:
        mixed = _mixed(spec, parts)
        expected = sum(weight * _cost(layout) for layout, weight in parts)
        if mixed is not None and _cost(mixed) < expected + WORSE:
            return mixed
    return _mixed(spec, [(near[0][0], 1.0)])


def _apart(layout: Layout, spec: DesignSpec) -> dict[str, float] | None:
    return None if layout.spec is None or layout.spec.fold_deg == "auto" else differences(spec, layout.spec)


def _spec_of(layout: Layout) -> DesignSpec:
    if layout.spec is None:
        raise ValueError("a layout without a spec, expected a design")
    return layout.spec


def _length(apart: dict[str, float]) -> float:
    return float(np.linalg.norm(list(apart.values())))


def _mixture(apart: Sequence[dict[str, float]]) -> FloatArray:
    """Weights (n), of the sum 1, of designs so far from a spec whose mixture is nearest to it; nearest first.

    The w >= 0 with the least |sum w_k x_k|^2 + (LOCAL |w_k x_k|)^2: near designs before far ones.
    """
    names = sorted({name for each in apart for name in each})
    places = np.array([[each.get(name, 0.0) for name in names] for each in apart]).reshape(len(apart), -1)
    lengths = np.linalg.norm(places, axis=1)
    if lengths[0] == 0.0:
        return np.eye(len(apart))[0]
    kept, weights = np.arange(len(apart)), np.zeros(len(apart))
    whole = 1e3 * lengths[0]
    while True:
        system = np.vstack([places[kept].T, LOCAL * np.diag(lengths[kept]), np.full((1, len(kept)), whole)])
        found, _ = nnls(system, np.append(np.zeros(len(system) - 1), whole))
        counts = found >= LEAST_WEIGHT * found.max()
        if counts.all():
            weights[kept] = found / found.sum()
            return weights
        kept = kept[counts]


def _mixed(spec: DesignSpec, parts: Sequence[tuple[Layout, float]]) -> Layout | None:
    """The layout of a spec with the weighted mean of designs; None where that has no mirrors."""
    low, high = sensor_rectangle(spec.camera)
    centres, corners = np.zeros((len(parts[0][0].mirrors), 3)), np.zeros(())
    for layout, weight in parts:
        own = _spec_of(layout)
        at_fold = spec if own.fold_deg == spec.fold_deg else spec.replaced(fold_deg=own.fold_deg)
        moved = seed_meeting(at_fold).centres - seed_meeting(own).centres
        centres += weight * (layout.virtual_centres_in_view_mm.reshape(-1, 3) / own.scale_mm + moved)
        own_low, own_high = sensor_rectangle(own.camera)
        seen = np.array([mirror.apparent.outline_normalized for mirror in layout.mirrors])
        corners = corners + weight * (low + (seen - own_low) * (high - low) / (own_high - own_low))
    centres += spec.view_from_rig[:, 2] - [0.0, 0.0, 1.0] - centres[list(spec.arrangement.inner)].mean(axis=0)
    corners = np.clip(corners, *sensor_bounds(spec.camera))
    made_by = {
        "made_by": "optics.design.preview.preview",
        "preview": "between designs of other specifications, neither optimised nor checked",
        "designs": " ".join(layout.identity for layout, _ in parts),
    }
    try:
        return layout_of(spec, mirrors_of(spec, centres * spec.scale_mm, _apart_on_sensor(spec, corners)), made_by)
    except InfeasibleDesign:
        return None


def _apart_on_sensor(spec: DesignSpec, corners: FloatArray) -> FloatArray:
    """Corners (n, sides, 2) of sub-images, of which those shrink that leave the sensor or meet another.

    Raises InfeasibleDesign where that is not enough.
    """
    sensor = sensor_polygon(spec.camera).buffer(ON_SENSOR)
    for _ in range(MOST_ROUNDS):
        polygons = shapely.polygons(corners)
        wrong = ~shapely.covered_by(polygons, sensor)
        meeting = STRtree(polygons).query(polygons, predicate="intersects")
        wrong[meeting[0, meeting[0] != meeting[1]]] = True
        if not wrong.any():
            return corners
        middles = corners.mean(axis=1, keepdims=True)
        corners = middles + np.where(wrong, SHRINKING, 1.0)[:, None, None] * (corners - middles)
    raise InfeasibleDesign("spacing", "sub-images between those of designs near by overlap")


def _cost(layout: Layout) -> float:
    """The objective of a layout, with pixels as a pinhole sees them; from its figures, where it has them."""
    spec = _spec_of(layout)
    if layout.metrics:
        shares = [layout.metrics[f"pixel_efficiency_{depth_mm:g}mm"].value for depth_mm in spec.depths_mm]
    else:
        views = fields_of_view(layout)
        shares = [
            views.pixel_efficiency(views.common_region(depth_mm)[0], depth_mm) if depth_mm > views.reach_mm else 0.0
            for depth_mm in spec.depths_mm
        ]
    uneven = spec.tradeoff * (grid_error(layout) / REFERENCE_GRID_ERROR) ** 2
    return float(uneven + (1.0 - spec.tradeoff) * (1.0 - np.mean(shares)))
