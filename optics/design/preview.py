"""Previews of designs: immediate layouts, interpolated between solved designs for similar specifications."""

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
from mirrorcam.optics.design.search import check_obvious_infeasibility, converging_seed
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
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
"""Changes that cost about 0.01 of the sensor if mirrors do not adapt: relative for scale, depths and sensor, in degrees
for fold and tilts, relative to the scale for lengths and to its square for areas."""

SIDES = ("left", "top", "right", "bottom")

LOCALITY = 0.03
"""Weight of the distances of the mixed designs, relative to the distance between mixture and specification."""

MIN_WEIGHT = 0.02
"""Weight, relative to the largest, below which a design is dropped."""

MAX_INCREASE = 0.03
"""Maximum increase of a mixture's objective over the mean of its designs'; more shows different kinds of optima."""

MAX_ROUNDS, SHRINK_FACTOR, SENSOR_TOLERANCE = 10, 0.99, 1e-6
"""Rounds in which sub-images that overlap or leave the sensor shrink, the factor, and the sensor's tolerance."""


def differences(spec: DesignSpec, other: DesignSpec) -> dict[str, float] | None:
    """Signed differences of `other` from `spec`, in multiples of `CHANGES`, for parameters that differ.

    Depths count separately ("depths_mm 0"), as do the sensor's borders in normalized coordinates ("camera left"). The
    fold "auto" equals any fold. Returns None if counts, pattern, sides, shape, surface, the number of depths, objective
    or lens model differ, because neither design can then preview the other.
    """
    if _structure(spec) != _structure(other):
        return None
    scale_mm = float(np.sqrt(spec.scale_mm * other.scale_mm))
    changes = {"scale_mm": float(np.log(other.scale_mm / spec.scale_mm))}
    if "auto" not in (spec.fold_deg, other.fold_deg):
        changes["fold_deg"] = float(other.fold_deg) - float(spec.fold_deg)
    for k, (depth, other_depth) in enumerate(zip(spec.depths_mm, other.depths_mm, strict=True)):
        changes[f"depths_mm {k}"] = float(np.log(other_depth / depth))
    lengths = ("spacing_mm", "seen_gap_mm", "thickness_mm", "body_clearance_mm", "min_edge_mm", "robust_offset_mm")
    changes |= {name: (getattr(other, name) - getattr(spec, name)) / scale_mm for name in lengths}
    changes["min_area_mm2"] = (other.min_area_mm2 - spec.min_area_mm2) / scale_mm**2
    changes |= {name: getattr(other, name) - getattr(spec, name) for name in ("tradeoff", "robust_tilt_deg")}
    changes["aperture_mm"] = (other.camera.aperture_mm - spec.camera.aperture_mm) / scale_mm
    if other.camera != spec.camera:
        borders, other_borders = sensor_bounds(spec.camera), sensor_bounds(other.camera)
        shifts = (other_borders - borders) / (borders[1] - borders[0])
        changes |= {f"camera {side}": float(shift) for side, shift in zip(SIDES, shifts.ravel(), strict=True)}
    in_units = {name: value / CHANGES[name.partition(" ")[0]] for name, value in changes.items()}
    return {name: value for name, value in in_units.items() if value != 0.0}


def _structure(spec: DesignSpec) -> tuple[object, ...]:
    shape = (spec.arrangement.rows, spec.arrangement.cols, spec.pattern, spec.sides, spec.surface, spec.shape)
    return (*shape, spec.size_step_mm, spec.same_size, len(spec.depths_mm), spec.objective, spec.camera.lens_model)


def preview(spec: DesignSpec, solved: Sequence[Layout]) -> Layout | None:
    """Predict the design of a spec from designs for other specs, in milliseconds.

    Virtual centres and corners of sub-images are a weighted mean over the designs whose mean spec comes nearest: linear
    interpolation between two designs, and the nearest design outside their range. The nearest design alone is used if
    the optima are of different kinds. Scale, fold and sensor are the spec's, and virtual centres follow the search's
    seed with scale, depths and camera. Sub-images that would overlap or leave the sensor shrink. Nothing is optimised;
    gaps and light are not checked.

    Parameters
    ----------
    spec
        The requested design. The fold "auto" becomes the fold of the nearest design.
    solved
        Designs with their specs; those with another structure (see `differences`) are ignored.

    Returns
    -------
    Layout or None
        Nominal, without figures and verdict; its provenance states that it is a preview. None if no design is
        comparable, or shrinking does not separate the sub-images.
    """
    specs = ((layout, layout.spec) for layout in solved if layout.spec is not None and layout.spec.fold_deg != "auto")
    near = [(layout, change) for layout, other in specs if (change := differences(spec, other)) is not None]
    near.sort(key=lambda pair: _length(pair[1]))
    if not near:
        return None
    if spec.fold_deg == "auto":
        spec = spec.replaced(fold_deg=near[0][0].designed_spec.fold_deg)
    weights = _mixture([change for _, change in near])
    parts = [(layout, weight) for (layout, _), weight in zip(near, weights, strict=True) if weight]
    if len(parts) > 1:
        mixed = _mixed(spec, parts)
        expected = sum(weight * _cost(layout) for layout, weight in parts)
        if mixed is not None and _cost(mixed) < expected + MAX_INCREASE:
            return mixed
    return _mixed(spec, [(near[0][0], 1.0)])


def sketch(spec: DesignSpec) -> Layout:
    """The start of a search for a design as a layout without figures, in milliseconds: nothing is optimised or checked.

    With the default camera, it has 0.95 to 1.1 times the field of view of the design, and 0.7 to 0.85 times its
    standard deviation of depth. Mirrors in sizes that are sold shrink to the largest that fits. Raises InfeasibleDesign
    if there is none.
    """
    check_obvious_infeasibility(spec)
    seed = converging_seed(spec)
    centres_mm, sizes = seed.centres * spec.scale_mm, spec.rectangle_sizes
    mirrors = mirrors_of(spec, centres_mm, seed.corners)
    if sizes is not None and sizes.is_stock:
        shares = np.array([_sold_share(mirror, sizes.options_mm) for mirror in mirrors])
        middles = seed.corners.mean(axis=1, keepdims=True)
        mirrors = mirrors_of(spec, centres_mm, middles + shares[:, None] * (seed.corners - middles))
    made_by = {"made_by": "optics.design.preview.sketch", "preview": "neither optimised nor checked"}
    return layout_of(spec, mirrors, made_by)


def _sold_share(mirror: Mirror, sizes_mm: FloatArray) -> FloatArray:
    """The width and height (2,) of the largest size (n, 2) that fits into a mirror, relative to the mirror's."""
    own_mm = np.ptp(mirror.outline_in_plane_mm, axis=0)
    fitting = sizes_mm[(sizes_mm <= own_mm).all(axis=1)]
    if not len(fitting):
        raise InfeasibleDesign(
            "area", f"no size that is sold fits into a mirror of {own_mm[0]:.0f} x {own_mm[1]:.0f} mm"
        )
    return np.asarray(fitting[fitting.prod(axis=1).argmax()] / own_mm)


def _length(difference: dict[str, float]) -> float:
    return float(np.linalg.norm(list(difference.values())))


def _mixture(differences: Sequence[dict[str, float]]) -> FloatArray:
    """Weights (n,) with sum 1 of the mixture nearest to a spec, for designs sorted by their differences from it.

    They minimise |sum w_k x_k|^2 + (LOCALITY |w_k x_k|)^2 for w >= 0, which prefers near designs.
    """
    names = sorted({name for changes in differences for name in changes})
    count = len(differences)
    vectors = np.array([[changes.get(name, 0.0) for name in names] for changes in differences]).reshape(count, -1)
    lengths = np.linalg.norm(vectors, axis=1)
    if lengths[0] == 0.0:
        return np.eye(count)[0]
    active, weights = np.arange(count), np.zeros(count)
    penalty = 1e3 * lengths[0]
    while True:
        system = np.vstack([vectors[active].T, LOCALITY * np.diag(lengths[active]), np.full((1, len(active)), penalty)])
        solution, _ = nnls(system, np.append(np.zeros(len(system) - 1), penalty))
        large = solution >= MIN_WEIGHT * solution.max()
        if large.all():
            weights[active] = solution / solution.sum()
            return weights
        active = active[large]


def _mixed(spec: DesignSpec, parts: Sequence[tuple[Layout, float]]) -> Layout | None:
    """The layout of a spec from the weighted mean of designs; None if its mirrors are impossible."""
    low, high = sensor_rectangle(spec.camera)
    centres, corners = np.zeros((len(parts[0][0].mirrors), 3)), np.zeros(())
    for layout, weight in parts:
        solved = layout.designed_spec
        at_fold = spec if solved.fold_deg == spec.fold_deg else spec.replaced(fold_deg=solved.fold_deg)
        shift = converging_seed(at_fold).centres - converging_seed(solved).centres
        centres += weight * (layout.virtual_centres_in_view_mm.reshape(-1, 3) / solved.scale_mm + shift)
        solved_low, solved_high = sensor_rectangle(solved.camera)
        outlines = np.array([mirror.apparent.outline_normalized for mirror in layout.mirrors])
        corners = corners + weight * (low + (outlines - solved_low) * (high - low) / (solved_high - solved_low))
    centres += spec.view_from_rig[:, 2] - [0.0, 0.0, 1.0] - centres[list(spec.arrangement.inner)].mean(axis=0)
    corners = np.clip(corners, *sensor_bounds(spec.camera))
    made_by = {
        "made_by": "optics.design.preview.preview",
        "preview": "between designs of other specifications, neither optimised nor checked",
        "designs": " ".join(layout.identity for layout, _ in parts),
    }
    try:
        return layout_of(spec, mirrors_of(spec, centres * spec.scale_mm, _separated_on_sensor(spec, corners)), made_by)
    except InfeasibleDesign:
        return None


def _separated_on_sensor(spec: DesignSpec, corners: FloatArray) -> FloatArray:
    """Shrink sub-images (n, sides, 2) that leave the sensor or meet another.

    Raises InfeasibleDesign if that is not enough.
    """
    sensor = sensor_polygon(spec.camera).buffer(SENSOR_TOLERANCE)
    for _ in range(MAX_ROUNDS):
        polygons = shapely.polygons(corners)
        is_wrong = ~shapely.covered_by(polygons, sensor)
        touching = STRtree(polygons).query(polygons, predicate="intersects")
        is_wrong[touching[0, touching[0] != touching[1]]] = True
        if not is_wrong.any():
            return corners
        centroids = corners.mean(axis=1, keepdims=True)
        corners = centroids + np.where(is_wrong, SHRINK_FACTOR, 1.0)[:, None, None] * (corners - centroids)
    raise InfeasibleDesign("spacing", "interpolated sub-images overlap")


def _cost(layout: Layout) -> float:
    """The objective of a layout, for a pinhole camera; from its figures if it has them."""
    spec = layout.designed_spec
    if layout.metrics:
        efficiencies = [layout.metrics[f"pixel_efficiency_{depth_mm:g}mm"].value for depth_mm in spec.depths_mm]
    else:
        views = fields_of_view(layout)
        efficiencies = [
            views.pixel_efficiency(views.common_region(depth_mm)[0], depth_mm)
            if depth_mm > views.mirror_depth_mm
            else 0.0
            for depth_mm in spec.depths_mm
        ]
    grid_cost = spec.tradeoff * (grid_error(layout) / REFERENCE_GRID_ERROR) ** 2
    return float(grid_cost + (1.0 - spec.tradeoff) * (1.0 - np.mean(efficiencies)))
