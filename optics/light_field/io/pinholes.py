"""Views as parallel pinholes, and back: the form of structure-from-motion tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Views

Item = TypeVar("Item")
NEGLIGIBLE_PX = 1e-6
"""Negligible differences of principal points and focal lengths, for zero disparity at infinity."""
TOLERANCE_PX = 0.01
"""Tolerance of principal points and focal lengths for views that share a plane of zero disparity."""


def view_name(t: int, s: int) -> str:
    """Return the name of a view in files; sorted names are row by row."""
    return f"view_{t:02d}_{s:02d}"


def row_by_row(views: Mapping[tuple[int, int], Item]) -> tuple[tuple[int, int], list[Item]]:
    """Return numbers of rows and columns, and the views row by row; raises ValueError if views are missing.

    The views are counted first, because malicious names could state a grid that fills the memory.
    """
    rows, cols = (1 + max(index[axis] for index in views) for axis in (0, 1))
    if len(views) != rows * cols:
        raise ValueError(f"{len(views)} views, expected {rows}x{cols}")
    return (rows, cols), [views[index] for index in np.ndindex(rows, cols)]


def centres_in_rig_mm(views: Views) -> FloatArray:
    """Return the positions (t, s, 3) of the views in the rig frame, mm."""
    return views.positions_mm @ views.view_from_rig + views.reference_view_in_rig_mm


def views_of_pinholes(
    centres_mm: FloatArray, view_from_world: FloatArray, matrices: FloatArray, size: tuple[int, int], where: str
) -> Views:
    """Build views of pinholes at positions (t, s, 3) in a world, with matrices (t, s, 3, 3); the world becomes the rig.

    The central view is the reference. The plane of zero disparity follows from the principal points, which shift by
    f x / Z0, and the focal lengths, f (1 - z / Z0). Raises InputError if they are inconsistent.
    """
    rows, cols = centres_mm.shape[:2]
    central = (rows // 2, cols // 2)
    positions = (centres_mm - centres_mm[central]) @ view_from_world.T
    positions[central] = 0.0
    focal_px, centre = float(matrices[central][0, 0]), matrices[central][:2, 2]
    offsets = np.concatenate([matrices[..., :2, 2] - centre, matrices[..., :1, 0] - focal_px], axis=-1)
    shifts = focal_px * positions * [1.0, 1.0, -1.0]
    inverse_distance = float((offsets * shifts).sum() / max(np.square(shifts).sum(), np.finfo(float).tiny))
    if float(np.abs(offsets).max()) < NEGLIGIBLE_PX:
        inverse_distance = 0.0
    error_px = float(np.abs(offsets - inverse_distance * shifts).max())
    anisotropy_px = float(np.abs(matrices[..., 1, 1] - matrices[..., 0, 0]).max())
    if inverse_distance < 0 or max(error_px, anisotropy_px) > TOLERANCE_PX:
        reason = (
            f"off by {max(error_px, anisotropy_px):.3g} px"
            if inverse_distance >= 0
            else "there is none in front of them"
        )
        raise InputError(f"{where}: views do not share a plane of zero disparity, {reason}")
    reference = centres_mm[central]
    return Views(
        positions_mm=positions,
        focal_px=focal_px,
        centre_px=centre,
        width_px=size[0],
        height_px=size[1],
        reference_depth_mm=(1.0 / inverse_distance if inverse_distance else np.inf)
        + float(view_from_world[2] @ reference),
        reference_view_in_rig_mm=reference,
        view_from_rig=view_from_world,
        layout_identity="",
    )
