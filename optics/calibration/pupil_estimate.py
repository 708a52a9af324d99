"""The pupil in a calibration: estimated from the frames, and corners outside the unvignetted parts left out.

Where a mirror is vignetted, a corner out of focus is seen from the middle of the remaining part of the pupil, and light
fades across it: it is displaced by .1 px and more. There are few such corners, and they are not needed.

The border of a mirror cuts the disc of the pupil along a line: the light falls over f A |1 / d - 1 / focus|, for an
edge at the distance d. The blur of lens and pixels adds to the variance. Edges at different distances separate the
three.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.detection.border_light import STATIONS, STEP_PX, BoardFrame, BorderLight, border_light
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Observations
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil, clear_aperture, outline_aperture, segment_share
from mirrorcam.optics.geometry.targets import Target

MARGIN_PX = 9.0
"""Between a corner and where the mirror begins to serve the whole pupil: the picture around it counts too."""
MIN_KEPT = 1.0 / 3.0
"""Part of a mirror's corners that must be left, or all of them are kept."""
MOST_FRAMES = 24
"""Frames that are used: more would not determine the pupil better."""
PASSES = 2
"""Estimates of the pupil, each with what rays through the parts of the last one show."""
LEAST_LENS_PX, LEAST_HALF_PX = 0.5, 0.5
"""Sigma of the blur of lens and pixels, and half the width of that by the pupil, that every border has at least."""
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
MIN_POINTS, MIN_BESIDE = 150, 20
"""Points of a border, and points on either side of it, that show it."""
INSIDE, OUTSIDE = -0.5, 0.2
"""Where points are entirely on either side, in `REACH_PX`."""
MIN_CONTRAST = 8.0
"""Grey levels between black and white, halved, below which a border is too dim."""
MODEL_PX2, MODEL_PART = 0.15, 0.02
"""Standard deviations of what the model leaves out: of the variance of a border, and of the diameter, in parts."""
NEARNESS_SIGMA = 0.002
"""Standard deviation, 1/mm, of one over the distance in focus about that of the layout's camera."""
LENS_PX2 = 1.0, 1.0
"""Variance of the blur of lens and pixels, and its standard deviation, before any border was seen."""
MIN_BORDERS = 6
STEPS = 30
OUTLIER_SIGMAS = 4.0


@dataclass(frozen=True)
class BoardPictures:
    """Pictures through the mirrors, in the order of their frames (None: not at hand), of a board.

    `workers` is the number of threads that look at them.
    """

    frames: Sequence[Grey | Path | None]
    target: Target
    workers: int = 1

    def placed(self, numbers: Sequence[int], rig_from_board: FloatArray) -> list[BoardFrame]:
        """Up to `MOST_FRAMES` pictures at hand of the numbers, with the poses (n, 4, 4) of their boards."""
        pairs = ((self.frames[number], pose) for number, pose in zip(numbers, rig_from_board, strict=False))
        return [BoardFrame(picture, pose) for picture, pose in pairs if picture is not None][:MOST_FRAMES]


@dataclass(frozen=True)
class EstimatedPupil:
    """The camera with the pupil that frames show, as far as they show it, figures of it and a note."""

    camera: Camera
    metrics: dict[str, Metric]
    note: str


def estimated_pupil(layout: Layout, frames: Sequence[BoardFrame], target: Target) -> EstimatedPupil:
    """The pupil of a layout's camera from frames; where they do not show it, the camera's is kept.

    Parameters
    ----------
    layout
        A layout whose camera, mirror planes and outlines are right.
    frames
        Frames through its mirrors.
    target
        The board.
    """
    seen, trial = _seen(layout, frames, target), layout
    for _ in range(PASSES - 1):
        if seen is not None:
            trial = layout.replaced(camera=_with_pupil(layout.camera, seen))
            seen = _seen(trial, frames, target)
    if seen is None:
        return EstimatedPupil(layout.camera, {}, _unseen(layout.camera))
    camera = _with_pupil(layout.camera, seen)
    metrics = {
        "aperture_mm": Metric(value=seen.aperture_mm, unit="mm"),
        "aperture_sigma_mm": Metric(value=seen.aperture_sigma_mm, unit="mm"),
    }
    if seen.shows_focus:
        metrics["focus_mm"] = Metric(value=camera.focus_mm, unit="mm")
        metrics["focus_sigma_per_m"] = Metric(value=1e3 * seen.nearness_sigma, unit="1/m")
    return EstimatedPupil(camera, metrics, _told(seen, camera))


def _seen(layout: Layout, frames: Sequence[BoardFrame], target: Target) -> SeenPupil | None:
    return seen_pupil(layout, border_light(layout, frames, target))


def _with_pupil(camera: Camera, seen: SeenPupil) -> Camera:
    if seen.is_pinhole:
        return camera.with_pupil(Pupil(0.0, camera.focus_mm))
    focus_mm = float(np.clip(1.0 / seen.nearness, DEPTH_MM.least, DEPTH_MM.most))
    return camera.with_pupil(Pupil(seen.aperture_mm, focus_mm if seen.shows_focus else camera.focus_mm))


def _unseen(camera: Camera) -> str:
    given = f"{camera.aperture_mm:g} mm wide and in focus at {camera.focus_mm:g} mm"
    kept = given if camera.aperture_mm > 0.0 else "a pinhole"
    return f"the frames do not show the blur of enough mirrors' edges to tell the pupil: {kept}, as in the layout"


def _told(seen: SeenPupil, camera: Camera) -> str:
    width = f"the pupil is {seen.aperture_mm:.2f} ± {seen.aperture_sigma_mm:.2f} mm wide"
    edges = f"by the blur of {seen.borders} mirror edges"
    if seen.is_pinhole:
        return f"{width}, {edges}: a pinhole, and the distance in focus cannot be told"
    per_m, sigma_per_m = 1e3 * seen.nearness, 1e3 * seen.nearness_sigma
    if seen.shows_focus:
        return f"{width} and in focus at {camera.focus_mm:.0f} mm ({per_m:.2f} ± {sigma_per_m:.2f} per metre), {edges}"
    return f"{width}, {edges}; they do not tell the distance in focus, which is the layout's {camera.focus_mm:g} mm"


def unvignetted(layout: Layout, observations: Observations) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Mask (n,) of the corners that are unvignetted, by `MARGIN_PX`, and notes.

    Corners of the bare camera are, and so are all of a pinhole's.
    """
    kept = np.ones(len(observations), dtype=np.bool_)
    if layout.camera.aperture_mm == 0.0:
        return kept, ()
    notes = []
    for index, mirror in enumerate(layout.mirrors):
        rows = np.flatnonzero(observations.view == index)
        whole = _beyond_px(layout.camera, mirror, observations.pixels[rows]) > MARGIN_PX
        if whole.sum() < MIN_KEPT * len(rows):
            name = layout.mirror_names[index]
            notes.append(f"mirror {name}: hardly any corner is seen by the whole pupil, all are used")
        else:
            kept[rows] = whole
    few = np.bincount(observations.frame, weights=kept, minlength=1) < MIN_CORNERS
    kept |= few[observations.frame]
    left_out = int((~kept).sum())
    if left_out:
        notes.append(f"{left_out} of {len(kept)} corners left out: near mirrors' edges, which the pupil sees partly")
    return kept, tuple(notes)


def _beyond_px(camera: Camera, mirror: Mirror, pixels: FloatArray) -> FloatArray:
    """Distance (n,) of pixels from where the mirror begins to serve the whole pupil, inwards."""

    def inside_mm(at: FloatArray) -> FloatArray:
        return clear_aperture(mirror, camera.normalized_from_pixels(at), camera.focus_mm).distance

    here = inside_mm(pixels)
    slope = np.hypot(*(inside_mm(pixels + step) - here for step in np.eye(2)))
    return np.asarray(((here - camera.pupil.radius_mm) / slope).min(axis=1))


@dataclass(frozen=True)
class BorderBlur:
    """Variance of the blur across the middle of a border of a plane mirror, px^2, with its standard deviation.

    `ends` (2, 2) are normalized coordinates a little inside and outside that middle, `apart_px` pixels apart.
    """

    aperture: Mirror
    variance_px2: float
    sigma_px2: float
    ends: FloatArray
    apart_px: float

    def px_per_mm(self, nearness: float) -> float:
        """Half the width of the blur by the pupil, px, per mm of its radius, for 1 / focus."""
        inside, outside = outline_aperture(self.aperture, self.ends, 1.0 / nearness).distance.min(axis=1)
        return self.apart_px / float(inside - outside)


@dataclass(frozen=True)
class SeenPupil:
    """The pupil that explains the blur of borders.

    Attributes
    ----------
    square_mm2, square_sigma_mm2
        The square of its diameter, whose error is nearly normal down to 0; it may come out negative.
    nearness, nearness_sigma
        One over the distance in focus, 1/mm.
    borders
        How many borders show it.
    """

    square_mm2: float
    square_sigma_mm2: float
    nearness: float
    nearness_sigma: float
    borders: int

    @property
    def is_pinhole(self) -> bool:
        """Whether the borders are no wider than those of a pinhole, within three standard deviations."""
        return self.square_mm2 < 3.0 * self.square_sigma_mm2

    @property
    def shows_focus(self) -> bool:
        """Whether the borders determine the distance in focus, rather than the prior."""
        return not self.is_pinhole and self.nearness_sigma < NEARNESS_SIGMA / 2.0

    @property
    def aperture_mm(self) -> float:
        """Diameter of the pupil."""
        return float(np.sqrt(max(self.square_mm2, 0.0)))

    @property
    def aperture_sigma_mm(self) -> float:
        """By how much the diameter grows when its square grows by a standard deviation."""
        return float(np.sqrt(max(self.square_mm2, 0.0) + self.square_sigma_mm2)) - self.aperture_mm


@dataclass(frozen=True)
class _Profile:
    """Light and its sigma (n,) at points of a border: `inside_mm` of it in the pupil, at `along` and `across` -1 to 1.

    `mm_per_px` is the slope of `inside_mm` there and, in the middle of the border, `middle`.
    """

    light: FloatArray
    sigma: FloatArray
    inside_mm: FloatArray
    mm_per_px: FloatArray
    along: FloatArray
    across: FloatArray
    middle: float

    @classmethod
    def of(cls, layout: Layout, seen: BorderLight) -> _Profile:
        border, pupil = seen.border, layout.camera.pupil
        normalized = border.normalized(layout)
        shape = normalized.shape[:2]
        planes = outline_aperture(border.aperture, normalized.reshape(-1, 2), pupil.focus_mm)
        nearest, second = (each.reshape(shape) for each in np.partition(planes.distance, 1, axis=1)[:, :2].T)
        faces = np.isfinite(nearest)
        slope = -np.gradient(np.where(faces, nearest, 0.0), STEP_PX, axis=1)
        # Not where the next edge of the outline cuts the pupil too.
        good = faces & np.isfinite(seen.light) & (second > 1.5 * max(pupil.radius_mm, 1.0))
        along = np.broadcast_to(np.linspace(-1.0, 1.0, STATIONS)[:, None], shape)
        across = np.broadcast_to(border.out_px / border.out_px[-1], shape)
        return cls(
            light=seen.light[good],
            sigma=seen.sigma[good],
            inside_mm=nearest[good],
            mm_per_px=slope[good],
            along=along[good],
            across=across[good],
            middle=float(slope[shape[0] // 2, shape[1] // 2]),
        )

    @property
    def gain(self) -> float:
        """The light inside the border, 0 where either side of it is not seen."""
        inside = self.across < INSIDE
        enough = len(self.light) >= MIN_POINTS and min(inside.sum(), (self.across > OUTSIDE).sum()) >= MIN_BESIDE
        return float(np.median(self.light[inside])) if enough else 0.0

    def residuals(self, p: FloatArray) -> FloatArray:
        """Model less light, in sigmas, for the light in the middle and its slopes, shift, turn, and variance (6,)."""
        radius_mm = 2.0 * np.sqrt(p[5] - LEAST_LENS_PX**2) * self.middle
        inside_mm = self.inside_mm + (p[3] + p[4] * self.along) * self.mm_per_px
        served = sum(
            weight * segment_share((inside_mm + LEAST_LENS_PX * node * self.mm_per_px) / radius_mm)
            for node, weight in zip(NODES, WEIGHTS / WEIGHTS.sum(), strict=True)
        )
        return np.asarray(((p[0] + p[1] * self.along + p[2] * self.across) * served - self.light) / self.sigma)


def border_blur(layout: Layout, seen: BorderLight) -> BorderBlur | None:
    """The blur of a border, by least squares with its place and the light that falls off; None where it is not seen."""
    profile = _Profile.of(layout, seen)
    gain = profile.gain
    if gain < MIN_CONTRAST:
        return None
    half_px = max(layout.camera.pupil.radius_mm, 0.2) / profile.middle
    lens_px2 = LEAST_LENS_PX**2
    start = np.array([gain, 0.0, 0.0, 0.0, 0.0, lens_px2 + max(half_px, 2.0 * LEAST_HALF_PX) ** 2 / 4.0])
    least = np.append(np.full(5, -np.inf), lens_px2 + LEAST_HALF_PX**2 / 4.0)
    scale = np.array([gain, gain, gain, 1.0, 1.0, start[5]])
    found = least_squares(
        profile.residuals, start, bounds=(least, np.full(6, np.inf)), x_scale=scale, loss="soft_l1", f_scale=3.0
    )
    spread = max(2.0 * found.cost / (len(profile.light) - len(start)), 1.0)
    covariance = np.linalg.inv(found.jac.T @ found.jac + np.diag(1e-12 / scale**2)) * spread
    sigma = float(np.hypot(np.sqrt(covariance[5, 5]), MODEL_PX2))
    row, column = seen.border.pixels.shape[0] // 2, seen.border.pixels.shape[1] // 2
    ends = seen.border.normalized(layout)[row, [column - 1, column + 1]]
    return BorderBlur(seen.border.aperture, float(found.x[5]), sigma, ends, 2.0 * STEP_PX)


def seen_pupil(layout: Layout, lights: Sequence[BorderLight]) -> SeenPupil | None:
    """The pupil from the light across the borders of a calibrated layout; None where too few of them are seen.

    The blur of borders that deviate from the others is left out, and the others count as much as they agree.
    """
    blurs = [blur for light in lights if (blur := border_blur(layout, light)) is not None]
    while len(blurs) >= MIN_BORDERS:
        found, off, covariance = _fitted(layout, blurs)
        limit = OUTLIER_SIGMAS * max(1.4826 * float(np.median(np.abs(off))), 1.0)
        kept = [blur for blur, each in zip(blurs, np.abs(off), strict=True) if each < limit]
        if len(kept) == len(blurs):
            covariance = covariance * max(float(np.square(off).sum()) / (len(off) - 2), 1.0)
            square_sigma = np.hypot(np.sqrt(covariance[0, 0]), 2.0 * MODEL_PART * max(found[0], 0.0))
            nearness_sigma = float(np.sqrt(covariance[1, 1]))
            return SeenPupil(float(found[0]), float(square_sigma), float(found[1]), nearness_sigma, len(blurs))
        blurs = kept
    return None


def _fitted(layout: Layout, blurs: Sequence[BorderBlur]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Squared diameter, 1 / focus and the lens's variance (3,); what is left in sigmas (n,); and the covariance."""
    given = np.array([0.0, 1.0 / layout.camera.focus_mm, LENS_PX2[0]])
    trust = np.array([0.0, 1.0 / NEARNESS_SIGMA, 1.0 / LENS_PX2[1]])
    variance, sigma = np.array([(blur.variance_px2, blur.sigma_px2) for blur in blurs]).T
    p = np.array([max(layout.camera.aperture_mm, 0.5) ** 2, *given[1:]])
    step = 1e-6
    for _ in range(STEPS):
        here, nearer = (np.array([blur.px_per_mm(p[1] + more) ** 2 / 16.0 for blur in blurs]) for more in (0.0, step))
        slopes = np.column_stack([here, p[0] * (nearer - here) / step, np.ones(len(blurs))]) / sigma[:, None]
        off = (variance - p[0] * here - p[2]) / sigma
        information = slopes.T @ slopes + np.diag(trust**2)
        move = np.linalg.solve(information, slopes.T @ off + trust**2 * (given - p))
        p = p + move
        p[1] = np.clip(p[1], 1e-6, 0.1)  # beyond a kilometre, or within a centimetre
        if (np.abs(move) < 1e-6 * np.array([1.0, 1e-3, 1.0])).all():
            break
    return p, off, np.linalg.inv(information)
