"""The parts of sub-images whose whole pupil a mirror serves, of one mirror or of many at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.convex_polygons import each_clipped
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil, passing

FARTHEST_PARTS = 10.0
"""Ways from an edge to the middle of its outline, within which a border is that leaves anything."""


def whole_pupil_outline(mirror: Mirror, pupil: Pupil) -> FloatArray:
    """Corners (n, 2) of the part of a sub-image whose whole pupil the mirror serves, in normalized coordinates.

    (0, 2) where there is none.
    """
    return whole_pupil_outlines_of([mirror], pupil)[0]


def whole_pupil_outlines_of(mirrors: Sequence[Mirror], pupil: Pupil) -> list[FloatArray]:
    """The `whole_pupil_outline` (n, 2) of each mirror, found together."""
    outlines = [mirror.usable_normalized for mirror in mirrors]
    showing = [k for k, shown in enumerate(outlines) if len(shown)]
    if pupil.radius_mm == 0.0 or not showing:
        return outlines
    most = max(len(outlines[k]) for k in showing)
    shown = np.array([outlines[k][np.minimum(np.arange(most), len(outlines[k]) - 1)] for k in showing])
    normals = np.array([mirrors[k].apparent.normal_in_rig for k in showing])
    distances_mm = np.array([mirrors[k].apparent.distance_mm for k in showing])
    for k, outline in zip(showing, whole_pupil_outlines(shown, normals, distances_mm, pupil), strict=True):
        outlines[k] = outline[(outline != np.roll(outline, 1, axis=0)).any(axis=1)]
    return outlines


def whole_pupil_outlines(shown: FloatArray, normals: FloatArray, distances_mm: FloatArray, pupil: Pupil) -> FloatArray:
    """The parts of sub-images whose whole pupil is served by n mirrors, each by one, in normalized coordinates.

    Their borders, of which each is nearly straight, are drawn straight and run inside.

    Parameters
    ----------
    shown
        Corners (n, k, 2) of the parts that mirrors show to the middle of the pupil; with fewer, the last is repeated.
    normals, distances_mm
        Planes of the apparent mirrors: unit normals (n, 3) in the frame of the camera, and distances (n,).
    pupil
        Of a lens, not of a pinhole.

    Returns
    -------
    Corners (n, most, 2), the last repeated; all zero where there is no such part.
    """
    following = np.roll(shown, -1, axis=1)
    distinct = (following != shown).any(axis=2)
    middles = (shown * distinct[..., None]).sum(axis=1) / np.maximum(distinct.sum(axis=1), 1)[:, None]
    ends = np.stack([shown, following], axis=2)
    inwards = middles[:, None, None] - ends
    parts = _parts_to_whole_pupil(ends, middles, normals, distances_mm, pupil)
    found = ((parts >= 0.0) & (parts < FARTHEST_PARTS)).all(axis=2) | ~distinct
    borders = ends + np.where(found[..., None], parts, 0.0)[..., None] * inwards
    along = borders[:, :, 1] - borders[:, :, 0]
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    across *= np.sign((inwards[:, :, 0] * across).sum(axis=-1, keepdims=True))
    kept = shown * found.all(axis=1)[:, None, None]
    for k in range(shown.shape[1]):
        heights = ((kept - borders[:, None, k, 0]) * across[:, None, k]).sum(axis=-1)
        kept = each_clipped(kept, np.where(distinct[:, k, None], heights, 1.0))
    return kept


def _parts_to_whole_pupil(
    ends: FloatArray, middles: FloatArray, normals: FloatArray, distances_mm: FloatArray, pupil: Pupil
) -> FloatArray:
    """Parts (n, k, 2) of the ways from the ends of edges (n, k, 2, 2) to middles (n, 2) after which pupils are whole.

    NaN where none is: on the way, constant and slope of `passing` are linear, and their quotient is the radius where
    a quadratic equation is solved.
    """
    middles = np.broadcast_to(middles[:, None, None], (*ends.shape[:2], 1, 2))
    chief = np.concatenate([ends, middles], axis=2)
    rays = np.concatenate([chief, np.ones((*chief.shape[:3], 1))], axis=3)
    points = rays * (-distances_mm[:, None, None] / (rays @ normals[:, None, :, None])[..., 0])[..., None]
    edges = np.stack([points[:, :, None, 0], points[:, :, None, 1]])
    constants, slopes, _ = passing(edges, points[:, :, 2], rays, 1.0 / pupil.focus_mm)
    constant, slope = constants[..., 0], pupil.radius_mm * slopes[..., 0, :]
    more, turn = constant[:, :, 2:] - constant[:, :, :2], slope[:, :, 2:] - slope[:, :, :2]
    constant, slope = constant[:, :, :2], slope[:, :, :2]
    square, product, least = (
        one * other - (first * second).sum(axis=-1)
        for one, other, first, second in (
            (more, more, turn, turn),
            (constant, more, slope, turn),
            (constant, constant, slope, slope),
        )
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-least / (product + np.sqrt(product**2 - square * least)))
