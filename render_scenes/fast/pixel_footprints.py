"""Footprints of subpixels: the mirrors visible in each and the virtual origin of its light, shared by all frames.

At the edge of a mirror, which is out of focus, the mirror vignettes the pupil. The light of a pixel then appears to
come through the centroid of the unvignetted part.

Light that reaches the pupil via a plane mirror appears to come from its virtual centre. Via a second-surface mirror,
light of one direction appears to come from a point on the line through the pupil along the mirror's normal. After k
passes to the coating and back, it leaves the front at a distance 2 k t tan a' from its point of entry (a and a' are its
angles in air and glass), as if the virtual centre of the *front* were shifted by 2 k t tan a' / tan a towards the back.
k = 0 is the ghost reflected by the front, k = 1 the image, k = 2 and 3 the ghosts of one and two internal reflections
at the front.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import surface_reflectance, tangent_in_glass
from mirrorcam.optics.geometry.pupil import (
    DiscPart,
    HalfPlanes,
    Pupil,
    clear_aperture,
    concatenated,
    disc_part,
    incidence_tangent,
)
from mirrorcam.render_scenes.fast.print_map import front_distance_mm
from mirrorcam.render_scenes.lens import undistorted_pixels

PASSES = 4  # a fourth reflection at the coating is neglected: less than 0.02 % in acrylic
BLOCK = 8  # subpixels along each side of a block in the classification
EDGE_SAMPLES = 4  # along each side of a subpixel at the edge of a mirror
MIN_BLUR = 4.0  # radius of the pupil, in units of the edge's motion per subpixel, below which subpixels are sampled


@dataclass(frozen=True)
class PixelFootprints:
    """Subpixels of the sensor on an optical path, without repetition; all arrays but `steps` are (n,).

    Attributes
    ----------
    view
        Index of the path's view: its mirror's, or 0 for the bare camera.
    subpixel
        Index of the subpixel in the picture, row by row.
    x, y
        Normalized image coordinates of its centre.
    centre_shift_mm
        Shift of the view's centre along the mirror's normal, towards the back.
    weight
        Throughput of mirror and plate, times the mirror's unvignetted fraction of the pupil or, for a pinhole, the
        fraction of the subpixel.
    pupil_x, pupil_y
        Point at which the ray from the centroid of the unvignetted part crosses z = 0, mm.
    relative_spread
        Standard deviation of this part about its centroid, divided by the full pupil's.
    steps
        (2, 2): mean change of x and y (rows) to the next subpixel to the right and down (columns).
    """

    view: int
    subpixel: NDArray[np.uint32]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    centre_shift_mm: NDArray[np.float32]
    weight: NDArray[np.float32]
    pupil_x: NDArray[np.float32]
    pupil_y: NDArray[np.float32]
    relative_spread: NDArray[np.float32]
    steps: FloatArray


@dataclass(frozen=True)
class _Visible:
    """Indices (n,) of the subpixels that show a mirror, and the parts of the pupil that it does not vignette there."""

    subpixel: NDArray[np.int64]
    part: DiscPart


def pixel_footprints(
    camera: Camera, mirrors: tuple[Mirror, ...], subpixels: int, reflectances: FloatArray, pupil: Pupil
) -> tuple[tuple[PixelFootprints, ...], ...]:
    """Assign the subpixels of a sensor to optical paths, whose radiances add up.

    There is a path for each mirror and number of passes through its plate. With a pupil, a path includes a margin of
    subpixels of zero weight, so that it can be blurred there.

    Parameters
    ----------
    camera, mirrors
        The camera and its mirrors; without mirrors, the bare camera.
    subpixels
        Number of subpixels along each side of a pixel.
    reflectances
        Reflectance (mirrors,) of the coatings.
    pupil
        Pupil of the lens.

    Returns
    -------
    tuple
        The footprints of each path, separately for the full pupil and for parts of it. No subpixel occurs twice.
    """
    grid = _SensorGrid(camera, subpixels)
    if not mirrors:
        indices = np.arange(grid.count)
        return (
            (grid.footprints(0, indices, np.zeros(grid.count), np.ones(grid.count), _full_pupil(grid.count), pupil),),
        )
    views = []
    # Nearer mirrors first: a farther one gets at most the rest of the pupil.
    order = sorted(range(len(mirrors)), key=lambda index: front_distance_mm(mirrors[index]))
    for passes in range(PASSES):
        free = np.ones(grid.count)
        for index in order:
            mirror = mirrors[index]
            if passes > 0 and not mirror.is_second_surface:
                continue
            visible = grid.visible(mirror, passes, pupil)
            subpixel, share = visible.subpixel, np.minimum(visible.part.fraction, free[visible.subpixel])
            free[subpixel] -= share
            centre_shift_mm, throughput = _shift_and_throughput(
                mirror, passes, grid.points(subpixel), float(reflectances[index])
            )
            off_axis: NDArray[np.bool_] = np.asarray(visible.part.centroid.any(axis=1))
            footprints = [
                grid.footprints(
                    index,
                    subpixel[chosen],
                    centre_shift_mm[chosen],
                    (throughput * share)[chosen],
                    visible.part.selected(chosen),
                    pupil,
                )
                for chosen in (~off_axis, off_axis)
                if chosen.any()
            ]
            if footprints:
                views.append(tuple(footprints))
    return tuple(views)


def _full_pupil(count: int) -> DiscPart:
    return DiscPart(np.ones(count), np.zeros((count, 2)), np.tile([0.25, 0.25, 0.0], (count, 1)))


def _shift_and_throughput(
    mirror: Mirror, passes: int, normalized: FloatArray, reflectance: float
) -> tuple[FloatArray, FloatArray]:
    """Return the shift (n,), mm, of the centre, and the throughput (n,), along rays (n, 2)."""
    count = len(normalized)
    if not mirror.is_second_surface:
        return np.zeros(count), np.full(count, reflectance)
    tangent = incidence_tangent(mirror, normalized)
    front_reflectance = surface_reflectance(tangent, mirror.refractive_index)
    if passes == 0:
        return np.zeros(count), front_reflectance
    centre_shift_mm = 2.0 * passes * mirror.thickness_mm * tangent_in_glass(tangent, mirror.refractive_index) / tangent
    return centre_shift_mm, (1.0 - front_reflectance) ** 2 * reflectance**passes * front_reflectance ** (passes - 1)


class _SensorGrid:
    """The subpixels of a sensor, and the rays through them."""

    def __init__(self, camera: Camera, subpixels: int) -> None:
        self._shape = camera.height_px * subpixels, camera.width_px * subpixels
        rows, columns = ((np.arange(length) + 0.5) / subpixels - 0.5 for length in self._shape)
        self.normalized = undistorted_pixels(camera, columns, rows)

    @property
    def count(self) -> int:
        """Number of subpixels."""
        return self._shape[0] * self._shape[1]

    def points(self, subpixel: NDArray[np.int64]) -> FloatArray:
        """Return normalized coordinates (n, 2) of the centres of subpixels."""
        return np.asarray(self.normalized.reshape(-1, 2)[subpixel])

    def footprints(
        self,
        view: int,
        subpixel: NDArray[np.int64],
        centre_shift_mm: FloatArray,
        weight: FloatArray,
        part: DiscPart,
        pupil: Pupil,
    ) -> PixelFootprints:
        points = self.points(subpixel)
        x, y = points.T
        pupil_x, pupil_y = (pupil.radius_mm * part.centroid + pupil.centre_mm(points)).T

        def float32(values: FloatArray) -> NDArray[np.float32]:
            return np.ascontiguousarray(values, dtype=np.float32)

        sample = subpixel[:: max(len(subpixel) // 1000, 1)]
        return PixelFootprints(
            view=view,
            subpixel=subpixel.astype(np.uint32),
            x=float32(x),
            y=float32(y),
            centre_shift_mm=float32(centre_shift_mm),
            weight=float32(weight),
            pupil_x=float32(pupil_x),
            pupil_y=float32(pupil_y),
            relative_spread=float32(np.sqrt(2.0 * part.spread[:, :2].sum(axis=1))),
            steps=np.column_stack([step.mean(axis=0) for step in self._steps(sample)]),
        )

    def visible(self, mirror: Mirror, passes: int, pupil: Pupil) -> _Visible:
        """Return the subpixels that show a mirror after a number of passes through its plate."""
        rows, columns = (np.arange(0, length + BLOCK - 1, BLOCK).clip(max=length - 1) for length in self._shape)
        nodes = self.normalized[np.ix_(rows, columns)]
        planes = _unvignetted(mirror, nodes.reshape(-1, 2), pupil, passes)
        distance = planes.distance.min(axis=1).reshape(nodes.shape[:2])
        near = distance > -pupil.radius_mm
        if not near.any():
            return _Visible(np.zeros(0, dtype=np.int64), _full_pupil(0))
        top, bottom = _span(near.any(axis=1))
        left, right = _span(near.any(axis=0))
        distance = distance[top:bottom, left:right]
        # Largest change of the distance from one subpixel to the next; 1.5 allows for kinks at corners of the outline.
        step = 1.5 * _max_change_mm(distance) / BLOCK
        corners = np.stack([distance[:-1, :-1], distance[1:, :-1], distance[:-1, 1:], distance[1:, 1:]])
        # Inside a convex outline the distance within a block is smallest at one of its corners.
        unvignetted = corners.min(axis=0) > pupil.radius_mm + step
        mixed = ~unvignetted & (corners.max(axis=0) > -pupil.radius_mm - BLOCK * step)
        inside, edge = (self._subpixels(blocks, top, left) for blocks in (unvignetted, mixed))
        part, edge_distance = self._part(mirror, passes, edge, pupil, step)
        kept = part.fraction > 0.0
        if pupil.radius_mm > 0.0:
            kept |= edge_distance > -pupil.radius_mm - BLOCK * step
        return _Visible(
            np.concatenate([inside, edge[kept]]), concatenated(_full_pupil(len(inside)), part.selected(kept))
        )

    def _subpixels(self, blocks: NDArray[np.bool_], top: int, left: int) -> NDArray[np.int64]:
        """Return indices (n,) of the subpixels of blocks; the first is `top` and `left` blocks from the corner."""
        mask = np.kron(blocks, np.ones((BLOCK, BLOCK), dtype=np.bool_))
        rows, columns = np.nonzero(mask)
        rows, columns = rows + top * BLOCK, columns + left * BLOCK
        on_sensor = (rows < self._shape[0]) & (columns < self._shape[1])
        return np.asarray(rows[on_sensor] * self._shape[1] + columns[on_sensor])

    def _part(
        self, mirror: Mirror, passes: int, subpixel: NDArray[np.int64], pupil: Pupil, step_mm: float
    ) -> tuple[DiscPart, FloatArray]:
        """Return the unvignetted part of the pupil at subpixels (n,), and their distances (n,) from the edge, mm.

        If a subpixel covers much of the blurred edge, its fraction is the mean over `EDGE_SAMPLES` x `EDGE_SAMPLES`
        samples. If the part is empty, the centroid is the last point of the pupil to be vignetted.
        """
        planes = _unvignetted(mirror, self.points(subpixel), pupil, passes)
        part = disc_part(planes, pupil.radius_mm)
        nearest = planes.distance.argmin(axis=1)
        rows = np.arange(len(nearest))
        distance = planes.distance[rows, nearest]
        if pupil.radius_mm > MIN_BLUR * step_mm:
            empty = part.fraction == 0.0
            part.centroid[empty] = planes.direction[rows, nearest][empty]
            return part, distance
        blurred = np.abs(distance) < pupil.radius_mm + step_mm
        fractions = (np.arange(EDGE_SAMPLES) + 0.5) / EDGE_SAMPLES - 0.5
        right, down = self._steps(subpixel[blurred])
        offsets = fractions[:, None, None, None] * down + fractions[:, None, None] * right
        points = self.points(subpixel[blurred]) + offsets.reshape(EDGE_SAMPLES * EDGE_SAMPLES, -1, 2)
        samples = (_unvignetted(mirror, sample, pupil, passes) for sample in points)
        part.fraction[blurred] = np.mean([disc_part(planes, pupil.radius_mm).fraction for planes in samples], axis=0)
        return part, distance

    def _steps(self, subpixel: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Return steps (n, 2) in normalized coordinates from subpixels to the next ones on the right and below."""
        rows, columns = np.divmod(subpixel, self._shape[1])
        rows, columns = np.minimum(rows, self._shape[0] - 2), np.minimum(columns, self._shape[1] - 2)
        start = self.normalized[rows, columns]
        return self.normalized[rows, columns + 1] - start, self.normalized[rows + 1, columns] - start


def _span(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the range of indices where a mask (n,) is set, extended by one at either end."""
    indices = np.flatnonzero(mask)
    return max(int(indices[0]) - 1, 0), min(int(indices[-1]) + 2, len(mask))


def _unvignetted(mirror: Mirror, normalized: FloatArray, pupil: Pupil, passes: int) -> HalfPlanes:
    """Return the mirror's part of the pupil for rays (n, 2), as half-planes about the centre of the shifted pupil."""
    planes = clear_aperture(mirror, normalized, pupil.focus_mm, passes)
    centre_mm = pupil.centre_mm(normalized)[:, None]
    return HalfPlanes(planes.direction, planes.distance + (planes.direction * centre_mm).sum(axis=-1))


def _max_change_mm(distance: FloatArray) -> float:
    """Return the largest finite change of a distance (rows, columns) between adjacent nodes."""
    with np.errstate(invalid="ignore"):
        changes = [np.abs(np.diff(distance, axis=axis)) for axis in range(2)]
    return max(float(change[np.isfinite(change)].max(initial=0.0)) for change in changes)
