"""Light profiles across the borders of a mirror's sub-image, measured by comparing frames with the known print.

Over the frames, a pixel's grey value follows what the mirror shows there, in proportion to the part of the pupil that
the mirror fills. The rest of the pixel's light is constant (the gaps), or follows what the neighbouring mirror shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image, blurred_print, image_px_of_print, sample
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane
from mirrorcam.optics.geometry.pupil import disc_part, outline_aperture
from mirrorcam.optics.geometry.transforms import inverse

SEARCH_PX = 48.0
"""Range searched on either side of a border: more than half the width of its blur."""

STEP_PX = 2.0
PROFILES = 25
"""Number of profiles across a border."""

SKIPPED_ENDS = 0.12
"""Fraction of a border's length that is skipped at either end, near the adjacent border."""

MIN_LENGTH_PX = 60.0
BLUR_PX = 1.2
"""Assumed sigma of the print's blur in the picture; an error scales an entire profile."""

BOARD_MARGIN = 0.15
"""Distance inside the print's border, in squares, beyond which the print's value at a ray's hit is known."""

MAX_RADIUS_MM = 3.0
"""Distance of a mirror from a ray, in the pupil's plane, beyond which the mirror adds no light."""

MIN_FRAMES = 6
WHITE = 255.0
MIN_VARIANCE = 0.02
"""Minimum variance of the print, from -1 to 1, over the frames, after regression on the neighbour's image."""


@dataclass(frozen=True)
class BoardFrame:
    """A frame via the mirrors, and the pose (4, 4) of its board, rig_from_board, mm."""

    picture: Grey | Path
    rig_from_board: FloatArray

    @property
    def grey(self) -> Image:
        """Grey values (h, w)."""
        picture = read_image(self.picture, grey=True) if isinstance(self.picture, Path) else self.picture
        return np.asarray(picture, dtype=np.float32)


@dataclass(frozen=True)
class Border:
    """Points across a border of a sub-image: `PROFILES` profiles (rows), each from inside to outside (columns).

    Attributes
    ----------
    mirror
        Index of the mirror.
    aperture
        The plane mirror, on the front of the plate, whose outline bounds the light.
    pixels
        The points (s, d, 2), px; NaN off the sensor.
    out_px
        Their outward distances (d,) from the border.
    neighbour
        The other mirror that may add light there; None if there is none.
    """

    mirror: int
    aperture: Mirror
    pixels: FloatArray
    out_px: FloatArray
    neighbour: int | None

    def normalized(self, layout: Layout) -> FloatArray:
        """Normalized coordinates (s, d, 2) of the points."""
        return layout.camera.normalized_from_pixels(self.pixels)


@dataclass(frozen=True)
class BorderLight:
    """Light of the mirror at the points (s, d) of a border, in grey levels, and its standard deviation.

    It is half the difference between white and black, `level` is their mean. NaN, with infinite sigma, where the frames
    do not determine it.
    """

    border: Border
    light: FloatArray
    sigma: FloatArray
    level: FloatArray

    def from_srgb(self) -> BorderLight:
        """Return the light of pictures whose grey levels are encoded as sRGB, with the noise of the white side."""
        white, black = (_linear_light(self.level + sign * self.light) for sign in (1.0, -1.0))
        step = 0.5
        slope = np.nanmax(_linear_light(self.level + self.light + step) - white, initial=0.0) / step
        determined = np.isfinite(self.sigma)
        sigma = np.multiply(slope, self.sigma, where=determined, out=np.full_like(self.sigma, np.inf))
        return BorderLight(self.border, (white - black) / 2.0, sigma, (white + black) / 2.0)


def _linear_light(grey: FloatArray) -> FloatArray:
    """Decode grey levels of sRGB (IEC 61966-2-1) to light of the same range."""
    encoded = np.maximum(grey, 0.0) / WHITE
    return WHITE * np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _aperture(mirror: Mirror) -> Mirror | None:
    """Return the plane mirror on a mirror's front that bounds the light equally; None for a mirror that shows nothing.

    For a first-surface mirror, it is the mirror itself.
    """
    usable = mirror.usable_normalized
    if not mirror.is_second_surface or not len(usable):
        return mirror if len(usable) else None
    centre = mirror.virtual_centre_in_rig_mm * (1.0 - mirror.front_mm / mirror.distance_mm)
    return Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=intersect_plane(usable, centre))


def borders(layout: Layout) -> list[Border]:
    """Return the borders of all sub-images that lie on the sensor."""
    found = []
    apertures = [_aperture(mirror) for mirror in layout.mirrors]
    for index, aperture in enumerate(apertures):
        if aperture is None:
            continue
        for edge in range(len(aperture.outline_in_rig_mm)):
            border = _border(layout, apertures, index, edge)
            if border is not None:
                found.append(border)
    return found


def _border(layout: Layout, apertures: Sequence[Mirror | None], index: int, edge: int) -> Border | None:
    aperture = apertures[index]
    if aperture is None:
        return None
    corners = aperture.outline_normalized
    start, end, centre = corners[edge], corners[(edge + 1) % len(corners)], corners.mean(axis=0)
    camera = layout.camera
    fractions = np.linspace(SKIPPED_ENDS, 1.0 - SKIPPED_ENDS, PROFILES)[:, None]
    points = camera.pixels_from_normalized(start + fractions * (end - start))
    size = np.array([camera.width_px, camera.height_px])
    if not ((points >= 0.0) & (points <= size - 1.0)).all() or np.linalg.norm(points[-1] - points[0]) < MIN_LENGTH_PX:
        return None
    tangents = np.gradient(points, axis=0)
    outward = np.column_stack([tangents[:, 1], -tangents[:, 0]]) / np.linalg.norm(tangents, axis=1)[:, None]
    outward *= np.sign((outward * (points - camera.pixels_from_normalized(centre))).sum(axis=1))[:, None]
    out_px = np.arange(-SEARCH_PX, SEARCH_PX + STEP_PX / 2.0, STEP_PX)
    pixels = points[:, None] + out_px[:, None] * outward[:, None]
    pixels[~((pixels >= 0.0) & (pixels <= size - 1.0)).all(axis=2)] = np.nan
    normalized = camera.normalized_from_pixels(pixels.reshape(-1, 2))
    inside_mm = [
        -np.inf if other in (None, aperture) else float(np.nanmax(_inside_mm(other, normalized, np.inf)))
        for other in apertures
    ]
    neighbour = int(np.argmax(inside_mm))
    return Border(index, aperture, pixels, out_px, neighbour if inside_mm[neighbour] > -MAX_RADIUS_MM else None)


def _inside_mm(mirror: Mirror, normalized: FloatArray, focus_mm: float) -> FloatArray:
    """Signed distance (n,) of the pupil's centre inwards from the border of the part that a mirror fills, mm."""
    return np.asarray(outline_aperture(mirror, normalized, focus_mm).distance.min(axis=1))


def border_light(layout: Layout, frames: Sequence[BoardFrame], board: CalibrationBoard) -> list[BorderLight]:
    """Measure the light of each mirror across the borders of its sub-image.

    Parameters
    ----------
    layout
        A calibrated layout; its pupil may be approximate.
    frames
        Frames via the mirrors.
    board
        The board.
    """
    measured = [(_Rays.of(layout, border), _Sums.of(border)) for border in borders(layout)]
    for frame in frames:
        grey = frame.grey
        board_from_rig = inverse(frame.rig_from_board)
        for rays, sums in measured:
            mirror_print, neighbour_print = (
                _print_values(board, *reflected, board_from_rig) for reflected in (rays.mirror, rays.neighbour)
            )
            sums.add(
                sample(grey, sums.border.pixels).astype(np.float64),
                mirror_print,
                np.where(rays.without_neighbour, 0.0, neighbour_print),
            )
    return [sums.light() for _, sums in measured]


@dataclass(frozen=True)
class _Rays:
    """Origins and directions (s, d, 3) of the rays of a border's points, reflected by its mirror and by the neighbour.

    `without_neighbour` (s, d) marks where the neighbour adds no light.
    """

    mirror: tuple[FloatArray, FloatArray]
    neighbour: tuple[FloatArray, FloatArray]
    without_neighbour: NDArray[np.bool_]

    @classmethod
    def of(cls, layout: Layout, border: Border) -> _Rays:
        normalized = border.normalized(layout)
        mirror_rays = _reflected_rays(layout, layout.mirrors[border.mirror], normalized)
        if border.neighbour is None:
            return cls(mirror_rays, mirror_rays, np.ones(normalized.shape[:2], dtype=bool))
        neighbour = layout.mirrors[border.neighbour]
        inside_mm = _inside_mm(neighbour, normalized.reshape(-1, 2), layout.camera.focus_mm)
        without_neighbour = ~(inside_mm > -MAX_RADIUS_MM).reshape(normalized.shape[:2])
        return cls(mirror_rays, _reflected_rays(layout, neighbour, normalized), without_neighbour)


def _reflected_rays(layout: Layout, mirror: Mirror, normalized: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Reflected rays from the centroid of the part of the pupil that a mirror fills: origins and directions."""
    pupil, flat, apparent = layout.camera.pupil, normalized.reshape(-1, 2), mirror.apparent
    start = np.zeros((len(flat), 3))
    start[:, :2] = pupil.radius_mm * disc_part(outline_aperture(mirror, flat, pupil.focus_mm), pupil.radius_mm).centroid
    rays = np.column_stack([flat, np.ones(len(flat))]) - start / pupil.focus_mm
    shape = (*normalized.shape[:2], 3)
    return apparent.reflect(start).reshape(shape), (rays @ apparent.reflection).reshape(shape)


def _print_values(
    board: CalibrationBoard, starts: FloatArray, directions: FloatArray, board_from_rig: FloatArray
) -> FloatArray:
    """Values of the print, from -1 to 1, where rays (s, d, 3) hit it; NaN where they miss the board."""
    rotation = board_from_rig[:3, :3].T
    start, direction = starts @ rotation + board_from_rig[:3, 3], directions @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        length = -start[..., 2] / direction[..., 2]
        hits = (start + length[..., None] * direction)[..., :2] / board.pitch_mm
    inside = (length > 0.0) & (direction[..., 2] > 0.0)
    inside &= ((hits > BOARD_MARGIN) & (hits < np.array(board.size_mm) / board.pitch_mm - BOARD_MARGIN)).all(axis=-1)
    steps = np.linalg.norm(np.diff(np.nan_to_num(hits), axis=1), axis=2)[inside[:, 1:] & inside[:, :-1]]
    if not len(steps):
        return np.full(hits.shape[:2], np.nan)
    hits = np.nan_to_num(hits)
    square_px = STEP_PX / max(float(np.median(steps)), 1e-6)
    value = sample(blurred_print(board, BLUR_PX / square_px).value, image_px_of_print(board, hits))
    return np.where(inside, value, np.nan)


@dataclass
class _Sums:
    """Normal equations over frames: grey values as a constant plus multiples of the mirror's and neighbour's prints."""

    border: Border
    normal: FloatArray
    rhs: FloatArray
    squares: FloatArray
    count: FloatArray

    @classmethod
    def of(cls, border: Border) -> _Sums:
        shape = border.pixels.shape[:2]
        return cls(border, np.zeros((*shape, 3, 3)), np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape))

    def add(self, grey: FloatArray, mirror_print: FloatArray, neighbour_print: FloatArray) -> None:
        valid = np.isfinite(mirror_print + neighbour_print)
        columns = (
            np.nan_to_num(np.stack([np.ones_like(mirror_print), mirror_print, neighbour_print], axis=-1))
            * valid[..., None]
        )
        self.normal += columns[..., :, None] * columns[..., None, :]
        self.rhs += columns * grey[..., None]
        self.squares += grey**2 * valid
        self.count += valid

    def light(self) -> BorderLight:
        """Solve for half the grey-value difference between white and black that the mirror adds."""
        inverse = np.linalg.inv(self.normal + 1e-6 * np.eye(3))
        coefficients = (inverse @ self.rhs[..., None])[..., 0]
        residual_squares = np.maximum(self.squares - (coefficients * self.rhs).sum(axis=-1), 0.0)
        determined = (self.count >= MIN_FRAMES) & (1.0 / inverse[..., 1, 1] > MIN_VARIANCE * self.count)
        noise = np.sqrt(residual_squares[determined].sum() / max(float((self.count - 3.0)[determined].sum()), 1.0))
        sigma = np.where(determined, noise * np.sqrt(np.maximum(inverse[..., 1, 1], 0.0)), np.inf)
        level, light = np.moveaxis(np.where(determined[..., None], coefficients[..., :2], np.nan), -1, 0)
        return BorderLight(self.border, light, sigma, level)
