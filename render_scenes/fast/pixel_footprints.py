"""Footprints of subpixels: the mirror that each shows and the virtual origin of its light, shared by all frames.

Light that reaches the pupil via a plane mirror appears to come from its virtual centre. Through a second-surface
mirror, light of one direction appears to come from a point on the line through the pupil along the mirror's normal:
after k passes to the coating and back it leaves the front 2 k t tan a' beside its point of entry (a' inside the plate),
as if the virtual centre of the *front* were shifted by 2 k t tan a' / tan a towards the back. k = 0 is the ghost
reflected by the front, k = 1 the image, k = 2 and 3 the ghosts of one and two internal reflections at the front.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import inner_tangent, surface_reflectance

PASSES = 4  # light that passed the coating four times, less than .02 % in acrylic, is left out
GRID_PX = 8.0  # spacing of exact undistortion; a quintic spline between the nodes is good to 1e-7 px
BLOCK = 8  # subpixels along each side of a block that is classified as a whole
FINE = 4  # samples along each side of a subpixel that the edge of a mirror cuts


@dataclass(frozen=True)
class VirtualView:
    """Light along (x, y, 1) in the camera appears to come from `centre_in_rig_mm` (3,) along `turn` (3, 3) @ (x, y, 1).

    These are the virtual centre and the reflection of a mirror's front, or zero and the identity of the bare camera.
    The centre is shifted along -`normal_in_rig` (3,) by `PixelFootprints.slide_mm`.
    """

    centre_in_rig_mm: FloatArray
    turn: FloatArray
    normal_in_rig: FloatArray


@dataclass(frozen=True)
class PixelFootprints:
    """Subpixels of the sensor that show a view, each once; all arrays but `steps` are (n,).

    Attributes
    ----------
    view
        Index of the view.
    square
        Index of the subpixel in the picture, row by row.
    x, y
        Normalized image coordinates of its centre.
    slide_mm
        Shift of the view's centre.
    weight
        Transmittance of mirror and plate, times the fraction of the subpixel that the mirror covers.
    steps
        (2, 2): mean change of x and y (rows) from one subpixel to the next, to the right and down (columns).
    """

    view: int
    square: NDArray[np.uint32]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    slide_mm: NDArray[np.float32]
    weight: NDArray[np.float32]
    steps: FloatArray


def virtual_views(mirrors: tuple[Mirror, ...]) -> tuple[VirtualView, ...]:
    """Return the view of each mirror; without mirrors, that of the bare camera."""
    if not mirrors:
        return (VirtualView(np.zeros(3), np.eye(3), np.zeros(3)),)
    return tuple(
        VirtualView(-2.0 * _front_distance_mm(mirror) * mirror.normal_in_rig, mirror.reflection, mirror.normal_in_rig)
        for mirror in mirrors
    )


def pixel_footprints(
    camera: Camera, mirrors: tuple[Mirror, ...], cut: int, reflectances: FloatArray
) -> tuple[tuple[PixelFootprints, ...], ...]:
    """Assign the subpixels of a sensor to views, in layers whose radiances add up.

    There is a layer for each number of passes through the plates, and another where subpixels show two mirrors; within
    a layer no subpixel occurs twice.

    Parameters
    ----------
    camera, mirrors
        The camera and its mirrors; without mirrors, the bare camera.
    cut
        Subpixels along each side of a pixel.
    reflectances
        Reflectance (mirrors,) of the coatings.

    Returns
    -------
    tuple
        Layers of footprints, one per view and layer.
    """
    grid = _SensorGrid(camera, cut)
    if not mirrors:
        nothing = np.zeros(grid.count)
        return ((grid.footprints(0, np.arange(grid.count), nothing, nothing + 1.0),),)
    layers: list[list[PixelFootprints]] = []
    # Nearer mirrors first: a farther one covers at most the rest of a subpixel.
    order = sorted(range(len(mirrors)), key=lambda index: _front_distance_mm(mirrors[index]))
    for passes in range(PASSES):
        free = np.ones(grid.count)
        alone: list[PixelFootprints] = []
        layers.append(alone)
        for index in order:
            mirror = mirrors[index]
            if passes > 0 and not mirror.is_second_surface:
                continue
            square, part = grid.seen(mirror, passes)
            shared = free[square] < 1.0
            part = np.minimum(part, free[square])
            free[square] -= part
            slide, light = _transmitted(mirror, passes, grid.points(square), float(reflectances[index]))
            alone.append(grid.footprints(index, square[~shared], slide[~shared], (light * part)[~shared]))
            shared &= part > 0.0
            if shared.any():
                layers.append([grid.footprints(index, square[shared], slide[shared], (light * part)[shared])])
    return tuple(tuple(footprints for footprints in layer if len(footprints.square)) for layer in layers if layer)


def _transmitted(
    mirror: Mirror, passes: int, normalized: FloatArray, reflectance: float
) -> tuple[FloatArray, FloatArray]:
    """Shift (n,), mm, of the centre, and transmittance (n,), along rays (n, 2)."""
    count = len(normalized)
    if not mirror.is_second_surface:
        return np.zeros(count), np.full(count, reflectance)
    tangent = _tangent(mirror, normalized)
    lost = surface_reflectance(tangent, mirror.refractive_index)
    if passes == 0:
        return np.zeros(count), lost
    slide = 2.0 * passes * mirror.thickness_mm * inner_tangent(tangent, mirror.refractive_index) / tangent
    return slide, (1.0 - lost) ** 2 * reflectance**passes * lost ** (passes - 1)


def _tangent(mirror: Mirror, normalized: FloatArray) -> FloatArray:
    """Tangent of the angle between rays (n, 2) and the mirror's normal; never quite zero."""
    n = mirror.normal_in_rig
    along = -(normalized @ n[:2] + n[2])
    squared = 1.0 + np.square(normalized).sum(axis=1)
    return np.sqrt(np.maximum(squared / along**2 - 1.0, 1e-12))


class _SensorGrid:
    """The subpixels of a sensor, and the rays through them."""

    def __init__(self, camera: Camera, cut: int) -> None:
        self._shape = camera.height_px * cut, camera.width_px * cut
        # Nodes up to the edge of the sensor, beyond which the lens model may have no rays.
        nodes = [np.linspace(-0.5, length / cut - 0.5, int(length / cut / GRID_PX) + 2) for length in self._shape]
        exact = camera.normalized_from_pixels(np.stack(np.meshgrid(nodes[1], nodes[0]), axis=-1))
        middles = [(np.arange(length) + 0.5) / cut - 0.5 for length in self._shape]
        splines = [RectBivariateSpline(*nodes, exact[..., axis], kx=5, ky=5) for axis in range(2)]
        self.normalized = np.stack([spline(*middles) for spline in splines], axis=-1)

    @property
    def count(self) -> int:
        """Number of subpixels."""
        return self._shape[0] * self._shape[1]

    def points(self, square: NDArray[np.int64]) -> FloatArray:
        """Normalized coordinates (n, 2) of the centres of subpixels."""
        return np.asarray(self.normalized.reshape(-1, 2)[square])

    def footprints(
        self, view: int, square: NDArray[np.int64], slide_mm: FloatArray, weight: FloatArray
    ) -> PixelFootprints:
        x, y = self.points(square).astype(np.float32).T
        return PixelFootprints(
            view=view,
            square=square.astype(np.uint32),
            x=np.ascontiguousarray(x),
            y=np.ascontiguousarray(y),
            slide_mm=slide_mm.astype(np.float32),
            weight=weight.astype(np.float32),
            steps=np.column_stack([step.mean(axis=0) for step in self._steps(square[:: max(len(square) // 1000, 1)])]),
        )

    def seen(self, mirror: Mirror, passes: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Subpixels (n,) that show a mirror after a number of passes through its plate, and their covered fractions."""
        rows, columns = (np.arange(0, length + BLOCK - 1, BLOCK).clip(max=length - 1) for length in self._shape)
        nodes = self.normalized[np.ix_(rows, columns)]
        outline = _front_outline(mirror)
        near = ((nodes >= outline.min(axis=0)) & (nodes <= outline.max(axis=0))).all(axis=-1)
        if not near.any():
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        top, bottom = _span(near.any(axis=1))
        left, right = _span(near.any(axis=0))
        margin = _margin_mm(mirror, passes, nodes[top:bottom, left:right])
        # Largest change of the margin from one subpixel to the next, with its kinks at the edges of the outline.
        step = 1.5 * max(float(np.abs(np.diff(margin, axis=axis)).max()) for axis in range(2)) / BLOCK
        corners = np.stack([margin[:-1, :-1], margin[1:, :-1], margin[:-1, 1:], margin[1:, 1:]])
        # Inside a convex outline the margin within a block is smallest at one of its corners.
        whole = corners.min(axis=0) > step
        mixed = ~whole & (corners.max(axis=0) > -BLOCK * step)
        inside, edge = (self._squares(blocks, top, left) for blocks in (whole, mixed))
        part = self._part(mirror, passes, edge, step)
        shown = part > 0.0
        return np.concatenate([inside, edge[shown]]), np.concatenate([np.ones(len(inside)), part[shown]])

    def _squares(self, blocks: NDArray[np.bool_], top: int, left: int) -> NDArray[np.int64]:
        """Indices (n,) of the subpixels of blocks, of which the first lies `top` and `left` blocks from the corner."""
        mask = np.kron(blocks, np.ones((BLOCK, BLOCK), dtype=np.bool_))
        rows, columns = np.nonzero(mask)
        rows, columns = rows + top * BLOCK, columns + left * BLOCK
        on = (rows < self._shape[0]) & (columns < self._shape[1])
        return np.asarray(rows[on] * self._shape[1] + columns[on])

    def _part(self, mirror: Mirror, passes: int, square: NDArray[np.int64], step_mm: float) -> FloatArray:
        """Fraction (n,) of subpixels that the mirror covers: by `FINE` x `FINE` samples where its edge may cut them."""
        margin = _margin_mm(mirror, passes, self.points(square))
        part = (margin >= step_mm).astype(np.float64)
        cut = np.abs(margin) < step_mm
        fine = (np.arange(FINE) + 0.5) / FINE - 0.5
        right, down = self._steps(square[cut])
        offsets = fine[:, None, None, None] * down + fine[:, None, None] * right
        points = self.points(square[cut]) + offsets.reshape(FINE * FINE, -1, 2)
        part[cut] = (_margin_mm(mirror, passes, points) > 0.0).mean(axis=0)
        return part

    def _steps(self, square: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Steps (n, 2) in normalized coordinates from subpixels to those on the right and below."""
        rows, columns = np.divmod(square, self._shape[1])
        rows, columns = np.minimum(rows, self._shape[0] - 2), np.minimum(columns, self._shape[1] - 2)
        start = self.normalized[rows, columns]
        return self.normalized[rows, columns + 1] - start, self.normalized[rows + 1, columns] - start


def _span(hit: NDArray[np.bool_]) -> tuple[int, int]:
    """Range of indices with hits, extended by one at either end."""
    found = np.flatnonzero(hit)
    return max(int(found[0]) - 1, 0), min(int(found[-1]) + 2, len(hit))


def _front_distance_mm(mirror: Mirror) -> float:
    """Distance of the front of a mirror from the pupil."""
    return mirror.distance_mm - mirror.front_mm


def _front_outline(mirror: Mirror) -> FloatArray:
    """Outline (n, 2) of the front of the plate, in normalized coordinates."""
    corners = mirror.outline_in_rig_mm + mirror.front_mm * mirror.normal_in_rig
    return np.asarray(corners[:, :2] / corners[:, 2:])


def _margin_mm(mirror: Mirror, passes: int, normalized: FloatArray) -> FloatArray:
    """Distance (...), mm, from the outline at which rays (..., 2) enter and leave the plate; negative outside."""
    distance = _front_distance_mm(mirror)
    rays = np.concatenate([normalized, np.ones((*normalized.shape[:-1], 1))], axis=-1)
    along = -(rays @ mirror.normal_in_rig)
    axes = mirror.rig_from_plane[:3, :2]
    foot_in_rig = -mirror.distance_mm * mirror.normal_in_rig
    enters = (rays @ axes) * (distance / along)[..., None]
    outline = (mirror.outline_in_rig_mm - foot_in_rig) @ axes
    edges = np.roll(outline, -1, axis=0) - outline
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    if ((outline.mean(axis=0) - outline) * outward).sum() > 0.0:
        outward = -outward
    least = (outline * outward).sum(axis=1)
    margin = (least - enters @ outward.T).min(axis=-1)
    if passes > 0:
        tangent = np.linalg.norm(enters, axis=-1) / distance
        on = 2.0 * passes * mirror.thickness_mm * inner_tangent(tangent, mirror.refractive_index)
        leaves = enters * (1.0 + on / np.maximum(tangent * distance, 1e-9))[..., None]
        margin = np.minimum(margin, (least - leaves @ outward.T).min(axis=-1))
    return np.asarray(np.where(along > 0.0, margin, -np.inf))
