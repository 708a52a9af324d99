"""Where a design starts: flat facets of a paraboloid (the paper's start) or of an ellipsoid, tiled over the sensor."""

from __future__ import annotations

import numpy as np
from pydantic import ValidationError
from scipy.optimize import brentq

from optics.camera import Camera
from optics.design.errors import InfeasibleDesign
from optics.design.metrics import smallest_gap_mm
from optics.files import one_line
from optics.layout import Layout
from optics.mirror import Mirror, cut
from optics.spec import DesignSpec
from optics.values import FloatArray, InputError

CENTRE_DECIMALS_MM = 6
NORMALIZED_DECIMALS = 8
OUTLINE_DECIMALS_MM = 9


def sensor_rectangle(camera: Camera) -> FloatArray:
    """The largest upright rectangle ((u_low, v_low), (u_high, v_high)) in normalized coordinates inside the sensor.

    Without distortion it is the sensor itself, out to the edges of its outermost pixels. Raises InputError where the
    lens model does not reach the sensor's border.
    """
    along = np.linspace(-0.5, 0.5, 65)
    x, y = along * camera.width_px, along * camera.height_px
    middle = np.array([(camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0])
    left, right, top, bottom = (
        camera.normalized_from_pixels(np.column_stack(np.broadcast_arrays(*edge)) + middle)
        for edge in ((x[0], y), (x[-1], y), (x, y[0]), (x, y[-1]))
    )
    rectangle = np.array(
        [[left[:, 0].max(), top[:, 1].max()], [right[:, 0].min(), bottom[:, 1].min()]], dtype=np.float64
    )
    if not np.isfinite(rectangle).all():
        raise InputError(f"camera {camera.name}: distortion {camera.distortion.tolist()} folds inside the sensor")
    return rectangle


def tiles(spec: DesignSpec, gap: float) -> FloatArray:
    """Sub-images (rows, cols, 4, 2) in normalized coordinates that tile the sensor with a gap between neighbours.

    Row 0, whose views are highest, lies where v is greatest, because the fold turns the image upside down. Corners
    run (u-, v-), (u+, v-), (u+, v+), (u-, v+).
    """
    low, high = sensor_rectangle(spec.camera)
    count = np.array([spec.cols, spec.rows])
    size = (high - low - (count - 1) * gap) / count
    u, v = (low[k] + np.arange(count[k]) * (size[k] + gap) for k in (0, 1))
    origins = np.stack(np.broadcast_arrays(u[None, :], v[::-1, None]), axis=-1)
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return origins[:, :, None] + unit * size


def parabola_centres(chief: FloatArray, scale_mm: float) -> FloatArray:
    """Virtual centres (..., 3) of facets tangent to a paraboloid (focus: pupil, axis: +y) where chief rays meet it.

    `chief` (..., 2) holds normalized coordinates. All virtual centres lie on the directrix plane y = -scale_mm, so all
    chief rays leave parallel to +y.
    """
    u, v = chief[..., 0], chief[..., 1]
    t = scale_mm / (np.sqrt(1.0 + u * u + v * v) - v)
    return np.stack([t * u, np.full_like(t, -scale_mm), t], axis=-1)


def ellipsoid_centres(chief: FloatArray, scale_mm: float, target_depth_mm: float) -> FloatArray:
    """Virtual centres (..., 3) of facets tangent to an ellipsoid with foci at the pupil and at a target.

    The target lies at (0, target_depth_mm, scale_mm); all chief rays meet there. The paraboloid is the limit of an
    infinitely far target. A point P on the surface has |P| + |P - target| = scale + depth, and its virtual centre is
    that far from the target on the line through P.
    """
    rays = np.concatenate([chief, np.ones((*chief.shape[:-1], 1))], axis=-1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    target = np.array([0.0, target_depth_mm, scale_mm])
    total = scale_mm + target_depth_mm
    points = rays * (scale_mm * target_depth_mm / (total - rays @ target))[..., None]
    away = points - target
    return target + total * away / np.linalg.norm(away, axis=-1, keepdims=True)


def mirrors_of(spec: DesignSpec, centres_mm: FloatArray, corners: FloatArray) -> tuple[Mirror, ...]:
    """Mirrors of virtual centres (n, 3) and of corners (n, k, 2) in normalized coordinates.

    The numbers are rounded first, so that noise in the last digits does not change a layout's identity; outlines are
    cut from the rounded numbers and lie on their planes to a nanometre.
    """
    mirrors = []
    for centre, quad in zip(centres_mm.round(CENTRE_DECIMALS_MM), corners.round(NORMALIZED_DECIMALS), strict=True):
        mirrors.append(
            Mirror(
                virtual_centre_in_rig_mm=centre + 0.0,
                outline_in_rig_mm=cut(quad, centre).round(OUTLINE_DECIMALS_MM) + 0.0,
                surface=spec.surface,
                thickness_mm=spec.thickness_mm,
                refractive_index=spec.refractive_index,
            )
        )
    return tuple(mirrors)


def layout_of(spec: DesignSpec, mirrors: tuple[Mirror, ...], made_by: dict[str, str]) -> Layout:
    """The nominal layout of mirrors, row by row. Raises InfeasibleDesign where two overlap in the image."""
    try:
        return Layout(
            rows=spec.rows, cols=spec.cols, camera=spec.camera, mirrors=mirrors, spec=spec, provenance=made_by
        )
    except ValidationError as error:
        raise InfeasibleDesign("spacing", one_line(error)) from None


def _parabola_with_gap(spec: DesignSpec, gap: float) -> Layout:
    corners = tiles(spec, gap).reshape(-1, 4, 2)
    centres = parabola_centres(corners.mean(axis=1), spec.scale_mm)
    return layout_of(spec, mirrors_of(spec, centres, corners), {"made_by": "optics.design.seeds.faceted_parabola"})


def faceted_parabola(spec: DesignSpec) -> Layout:
    """The paper's start: sub-images tile the sensor, facets are tangent to a paraboloid with its focus at the pupil.

    The gap in the image is the smallest that leaves `spacing_mm` between all mirrors. Raises InfeasibleDesign where no
    gap does.
    """
    low, high = sensor_rectangle(spec.camera)
    widest = float(((high - low) / np.maximum(np.array([spec.cols, spec.rows]) - 1, 1)).min())

    def excess_mm(gap: float) -> float:
        return smallest_gap_mm(_parabola_with_gap(spec, gap)) - spec.spacing_mm

    least = 1e-7
    if excess_mm(least) >= 0:
        return _parabola_with_gap(spec, least)
    greatest = 0.98 * widest
    missing_mm = -excess_mm(greatest)
    if missing_mm > 0:
        raise InfeasibleDesign(
            "spacing",
            f"facets {spec.spacing_mm:g} mm apart do not fit the parabola at scale {spec.scale_mm:g} mm: "
            f"they come {missing_mm:.3g} mm too close however small they are",
        )
    return _parabola_with_gap(spec, brentq(excess_mm, least, greatest, xtol=1e-7) + 2e-7)
