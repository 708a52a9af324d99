"""The pixel budget of a design, the roll of its views and the price of its constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program import constraints, separation
from mirrorcam.optics.design.program.design_problem import Problem
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.nonlinear_program import IPOPT
from mirrorcam.optics.design.program.terms import ELASTIC
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import common_region, seen_px, sensor_polygon, sub_images

ACTIVE = 1e-5
"""A multiplier above this part of the objective's scale (1) counts as active."""


@dataclass(frozen=True)
class Budget:
    """Parts of the sensor, by area; they add up to 1 (but for clipping).

    Seen and common at both depths, at one of them alone, the rest of the sub-images, and what no mirror shows.
    """

    both: float
    one: float
    rest: float
    between: float


def budget_of(layout: Layout, depths_mm: Sequence[float]) -> Budget:
    """Account for the sensor's pixels in a layout with two working depths, by polygon clipping."""
    camera = layout.camera
    whole = sensor_polygon(camera)
    regions = [common_region(layout, depth)[0] for depth in depths_mm]
    both = one = shown = 0.0
    for index, sub_image in enumerate(sub_images(layout)):
        near, far = (
            Polygon(camera.normalized_from_pixels(seen_px(layout, region, depth, index)))
            for region, depth in zip(regions, depths_mm, strict=True)
        )
        both += near.intersection(far).area
        one += near.symmetric_difference(far).area
        shown += sub_image.area
    parts = np.array([both, one, shown - both - one, whole.area - shown]) / whole.area
    return Budget(*parts.tolist())


def parallax_bound(layout: Layout, depths_mm: Sequence[float], densities: tuple[float, float] = (1.0, 1.0)) -> float:
    """No layout with views on this one's grid (of grid error 0) has a mean efficiency over two depths above this.

    In tangents of the view axes the common region A_k at a distance D_k lies at A_k - c_i / D_k in view i, so the two
    lie s_i = c_i (1 / D_1 - 1 / D_2) apart. A sub-image holds both, and pixels seen at one depth only count half. For a
    view and its opposite, |A_1 d (A_2 + s)| + |A_1 d (A_2 - s)| >= |A d (A + 2 s)| (symmetric differences, A either of
    them), and a convex A of longest chords L_x, L_y has |A d (A + (a, 0))| >= 2 |A| a / L_x, L_x L_y <= 2 |A|. Summed
    over pairs that is at least sqrt(2 P Q |A|), P the sum of a (twice that in the middle row), Q alike.

    `densities`: least and greatest area on the sensor of a unit of area in tangents; 1 where angles are small.
    """
    centres = layout.virtual_centres_in_view_mm
    steps = [centres[:, -1, 0] - centres[:, 0, 0], centres[-1, :, 1] - centres[0, :, 1]]
    step_x, step_y = (
        abs(float(step.mean())) / (count - 1) for step, count in zip(steps, (layout.cols, layout.rows), strict=True)
    )
    nearness = [1.0 / (depth - float(centres[..., 2].mean())) for depth in depths_mm]
    q = abs(nearness[0] - nearness[1])
    s, t = np.meshgrid(
        np.arange(layout.cols) - (layout.cols - 1) / 2.0, np.arange(layout.rows) - (layout.rows - 1) / 2.0
    )
    # Each pair of opposite views is met twice, hence the halves.
    p_sum = float(np.where(t == 0, 2.0, 1.0).ravel() @ np.abs(2.0 * s * step_x * q).ravel()) / 2.0
    q_sum = float(np.where(s == 0, 2.0, 1.0).ravel() @ np.abs(2.0 * t * step_y * q).ravel()) / 2.0
    sensor = sensor_polygon(layout.camera).area
    least, greatest = densities
    loss = 0.5 * least * np.sqrt(2.0 * p_sum * q_sum * sensor / (len(layout.mirrors) * greatest)) / sensor
    root = (np.sqrt(loss**2 + 4.0) - loss) / 2.0  # of e + loss sqrt(e) = 1
    return float(root**2)


def densities(layout: Layout, depths_mm: Sequence[float]) -> tuple[float, float]:
    """Least and greatest (cos a / cos b)^3 that light at an angle a to the views and b to the camera's axis can have.

    Of directions from the views to the regions, and of the sensor.
    """
    widest = 0.0
    centres = layout.virtual_centres_in_view_mm.reshape(-1, 3)
    for depth in depths_mm:
        corners = shapely.get_coordinates(common_region(layout, depth)[0])
        across = np.linalg.norm(corners[None] - centres[:, None, :2], axis=-1) / (depth - centres[:, None, 2])
        widest = max(widest, float(across.max()))
    farthest = float(np.linalg.norm(shapely.get_coordinates(sensor_polygon(layout.camera)), axis=-1).max())
    return (1.0 + widest**2) ** -1.5, (1.0 + farthest**2) ** 1.5


def rolls_deg(layout: Layout) -> FloatArray:
    """Angles (n,) by which views are rolled about their chief rays, measured: from pixels to a plane 1 m away.

    The rotation nearest to the derivative at the middle of the sub-image, after the handedness of one reflection is
    taken off.
    """
    found = []
    for mirror in layout.mirrors:
        middle = mirror.outline_normalized.mean(axis=0)

        def on_plane(
            point: FloatArray, mirror_centre: FloatArray = mirror.apparent.virtual_centre_in_rig_mm
        ) -> FloatArray:
            centre = layout.view_from_rig @ mirror_centre
            unit = centre / np.linalg.norm(centre)
            ray = layout.view_from_rig @ np.array([*point, 1.0])
            ray = ray - 2.0 * (ray @ unit) * unit
            return centre[:2] + ray[:2] / ray[2] * (1000.0 - centre[2])

        step = 1e-5
        columns = [(on_plane(middle + d) - on_plane(middle - d)) / (2.0 * step) for d in step * np.eye(2)]
        unmirrored = np.column_stack(columns) @ np.diag([1.0, -1.0])
        u, _, vt = np.linalg.svd(unmirrored)
        turned = u @ vt
        found.append(np.degrees(np.arctan2(turned[1, 0], turned[0, 0])))
    return np.array(found)


def expected_rolls_deg(layout: Layout, fold_deg: float) -> FloatArray:
    """u cot(fold / 2) for where each chief ray appears: to first order in (u, v)."""
    across = np.array([mirror.outline_normalized.mean(axis=0)[0] for mirror in layout.mirrors])
    return np.degrees(across / np.tan(np.radians(fold_deg) / 2.0))


@dataclass(frozen=True)
class Price:
    """Active constraints of a family and what they cost together: gain of the objective per unit of loosening."""

    active: int
    of: int
    price: float


def prices(spec: DesignSpec, problem: Problem, start: FloatArray) -> dict[str, Price]:
    """Multipliers at the optimum next to a start, summed by term and family.

    Per unit of the constraint: for gaps, light and sizes a scale (as seen: at the distance of the scale), for overlap a
    tile's worth of a cross product, for the sensor's borders the half width or height of the sensor.
    """
    solver = problem.solver
    program = solver.program
    x, p = ca.MX.sym("x", program.size), ca.MX.sym("p")
    f, g = solver.derivatives["grad_f"](x, p)[0], solver.derivatives["jac_g"](x, p)[0]
    nlp = ca.nlpsol("priced", "ipopt", {"x": x, "p": p, "f": f, "g": g}, IPOPT | solver.derivatives)
    low, high = (bound.copy() for bound in program.bounds)
    labels = _labels(spec, problem)
    upper_limits = np.where(labels == "mean", 0.0, np.inf)
    result = nlp(x0=start, lbx=low, ubx=high, p=0.0, lbg=np.zeros(len(labels)), ubg=upper_limits)
    if not nlp.stats()["success"]:
        raise RuntimeError(f"IPOPT did not come back to the optimum ({nlp.stats()['return_status']})")
    multipliers = np.abs(np.array(result["lam_g"]).ravel())
    found: dict[str, Price] = {}
    for name in sorted(set(labels) - {"mean"}):
        mine = multipliers[labels == name]
        found[name] = Price(int((mine > ACTIVE).sum()), len(mine), float(mine.sum()))
    corners = problem.corners.ravel()
    at_border = np.abs(np.array(result["lam_x"]).ravel()[corners]) * ((high - low) / 2.0)[corners]
    found["sensor's borders"] = Price(int((at_border > ACTIVE).sum()), 2 * corners.size, float(at_border.sum()))
    return found


def _labels(spec: DesignSpec, problem: Problem) -> NDArray[np.str_]:
    """The subject of each constraint of a program, in its order."""
    kind = Kind.of(spec)
    makers = {
        "cut": constraints.mirror_term,
        "overlap": constraints.view_term,
        "gap": separation.gap_term,
        "light in": separation.incoming_term,
        "light out": separation.outgoing_term,
        "camera's body: mirrors": separation.body_gap_term,
        "camera's body: light": separation.body_light_term,
    }
    names = {id(maker(kind)): name for name, maker in makers.items()}
    names |= {
        id(separation.seen_gap_term(spec.sides)): "gap as seen",
        id(constraints.grid_term(spec.arrangement)): "grid's spacing",
        id(constraints.region_term()): "region's shape",
    }
    parts = []
    for term, places, _ in problem.solver.program.uses:
        name = "mean" if term.equality else names[id(term)]
        of_each = [f"{name}: {ELASTIC[k]}" if name == "cut" and k >= 0 else name for k in term.family]
        parts.append(np.tile(of_each, len(places)))
    return np.concatenate(parts)
