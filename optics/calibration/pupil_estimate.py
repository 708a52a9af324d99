"""The lens's pupil in a calibration: estimated from the frames; vignetted corners are left out.

Where a mirror is vignetted, a corner out of focus appears displaced: it is viewed from the centroid of the remaining
part of the pupil, across which the light fades. The shift is 0.1 px or more. Few corners are affected, and the fit does
not need them.

A mirror's edge crosses the disc of the pupil along a line: at the distance d, the light falls off over
f A |1 / d - 1 / focus|. The blur of lens and pixels adds to the variance. Edges at different distances separate the
aperture A, the focus and that blur. Grey levels are proportional to light or, as of most webcams, encoded as sRGB: the
edges agree about the pupil only with the right one of both.
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
from mirrorcam.optics.calibration.detection.border_light import PROFILES, STEP_PX, BoardFrame, BorderLight, border_light
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil, clear_aperture, outline_aperture, segment_fraction

MARGIN_PX = 9.0
"""Minimum distance of a corner from the border of the unvignetted part, so that its patch is unvignetted as well."""
MIN_UNVIGNETTED = 1.0 / 3.0
"""Minimum fraction of a mirror's corners that are unvignetted; with fewer, all are kept."""
MAX_FRAMES = 24
"""Maximum number of frames used: more would not improve the estimate of the pupil."""
PASSES = 2
"""Number of estimates of the pupil; each traces rays through the unvignetted parts of the previous one."""
MIN_LENS_PX, MIN_HALF_WIDTH_PX = 0.5, 0.5
"""Lower bounds on the sigma of the blur by lens and pixels, and on the half width of the pupil's blur, per border."""
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
MIN_POINTS, MIN_POINTS_PER_SIDE = 150, 20
"""Minimum number of points of a border, and on either side of it."""
INSIDE, OUTSIDE = -0.5, 0.2
"""Positions across the border beyond which a point lies entirely on one side, in units of `SEARCH_PX`."""
MIN_CONTRAST = 8.0
"""Minimum of half the difference between white and black, in grey levels."""
MODEL_PX2, MODEL_RELATIVE = 0.15, 0.02
"""Standard deviations of model errors: of a border's variance, and of the diameter as a fraction of it."""
INVERSE_FOCUS_SIGMA = 0.002
"""Prior standard deviation of 1 / focus about the value of the layout's camera, 1/mm."""
LENS_PX2 = 1.0, 1.0
"""Prior mean of the variance of lens and pixel blur, and its prior standard deviation."""
MIN_BORDERS = 6
STEPS = 30
OUTLIER_SIGMAS = 4.0


@dataclass(frozen=True)
class BoardPictures:
    """Pictures of a board, those in the mirrors first, in the order of their frames; None where one is not available.

    `workers` is the number of threads that process them.
    """

    frames: Sequence[Grey | Path | None]
    board: CalibrationBoard
    workers: int = 1

    def with_poses(self, numbers: Sequence[int], rig_from_board: FloatArray) -> list[BoardFrame]:
        """Return up to `MAX_FRAMES` available pictures of the given frames, with their board poses (n, 4, 4)."""
        pairs = ((self.frames[number], pose) for number, pose in zip(numbers, rig_from_board, strict=False))
        return [BoardFrame(picture, pose) for picture, pose in pairs if picture is not None][:MAX_FRAMES]


@dataclass(frozen=True)
class EstimatedPupil:
    """The camera, with its pupil as far as the frames determine it, and metrics and a note."""

    camera: Camera
    metrics: dict[str, Metric]
    note: str


def estimated_pupil(layout: Layout, frames: Sequence[BoardFrame], board: CalibrationBoard) -> EstimatedPupil:
    """Estimate the pupil of a layout's camera from frames; keep the camera's own if they do not determine it.

    Parameters
    ----------
    layout
        A layout with calibrated camera, mirror planes and outlines.
    frames
        Frames through the layout's mirrors.
    board
        The board.
    """
    lights = border_light(layout, frames, board)
    fit, decoded = fit_pupil(layout, lights), fit_pupil(layout, [light.from_srgb() for light in lights])
    encoded = decoded is not None and (fit is None or decoded.relative_sigma < fit.relative_sigma)
    fit, trial = decoded if encoded else fit, layout
    for _ in range(PASSES - 1):
        if fit is not None:
            trial = layout.replaced(camera=_with_pupil(layout.camera, fit))
            lights = border_light(trial, frames, board)
            fit = fit_pupil(trial, [light.from_srgb() for light in lights] if encoded else lights)
    if fit is None:
        return EstimatedPupil(layout.camera, {}, _undetermined_note(layout.camera))
    camera = _with_pupil(layout.camera, fit)
    metrics = {
        "aperture_mm": Metric(value=fit.aperture_mm, unit="mm"),
        "aperture_sigma_mm": Metric(value=fit.aperture_sigma_mm, unit="mm"),
    }
    if fit.shows_focus:
        metrics["focus_mm"] = Metric(value=camera.focus_mm, unit="mm")
        metrics["focus_sigma_per_m"] = Metric(value=1e3 * fit.inverse_focus_sigma, unit="1/m")
    return EstimatedPupil(camera, metrics, _note(fit, camera))


def _with_pupil(camera: Camera, fit: PupilFit) -> Camera:
    if fit.is_pinhole:
        return camera.with_pupil(Pupil(0.0, camera.focus_mm))
    focus_mm = float(np.clip(1.0 / fit.inverse_focus, DEPTH_MM.min, DEPTH_MM.max))
    return camera.with_pupil(Pupil(fit.aperture_mm, focus_mm if fit.shows_focus else camera.focus_mm))


def _undetermined_note(camera: Camera) -> str:
    stated = f"{camera.aperture_mm:g} mm wide and in focus at {camera.focus_mm:g} mm"
    initial = stated if camera.aperture_mm > 0.0 else "a pinhole"
    return f"the frames show the blur of too few mirror edges to estimate the pupil: {initial}, as in the layout"


def _note(fit: PupilFit, camera: Camera) -> str:
    width = f"the pupil is {fit.aperture_mm:.2f} ± {fit.aperture_sigma_mm:.2f} mm wide"
    edges = f"by the blur of {fit.borders} mirror edges"
    if fit.is_pinhole:
        return f"{width}, {edges}: a pinhole, so the distance in focus is undetermined"
    per_m, sigma_per_m = 1e3 * fit.inverse_focus, 1e3 * fit.inverse_focus_sigma
    if fit.shows_focus:
        return f"{width} and in focus at {camera.focus_mm:.0f} mm ({per_m:.2f} ± {sigma_per_m:.2f} per metre), {edges}"
    return f"{width}, {edges}; they do not determine the distance in focus, kept at {camera.focus_mm:g} mm"


def unvignetted(layout: Layout, observations: Observations) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Return a mask (n,) of the corners at least `MARGIN_PX` inside the unvignetted parts, and notes.

    Corners of the bare camera and of a pinhole camera are always unvignetted.
    """
    kept = np.ones(len(observations), dtype=np.bool_)
    if layout.camera.aperture_mm == 0.0:
        return kept, ()
    notes = []
    for index, mirror in enumerate(layout.mirrors):
        rows = np.flatnonzero(observations.view == index)
        inside = _inside_px(layout.camera, mirror, observations.pixels[rows]) > MARGIN_PX
        if inside.sum() < MIN_UNVIGNETTED * len(rows):
            name = layout.mirror_names[index]
            notes.append(f"mirror {name}: hardly any corner is unvignetted, so all are used")
        else:
            kept[rows] = inside
    few = np.bincount(observations.frame, weights=kept, minlength=1) < MIN_CORNERS
    kept |= few[observations.frame]
    left_out = int((~kept).sum())
    if left_out:
        notes.append(f"{left_out} of {len(kept)} corners left out: vignetted, near mirrors' edges")
    return kept, tuple(notes)


def _inside_px(camera: Camera, mirror: Mirror, pixels: FloatArray) -> FloatArray:
    """Signed distance (n,) of pixels inwards from the border of the mirror's unvignetted part, px."""

    def inside_mm(points: FloatArray) -> FloatArray:
        return clear_aperture(mirror, camera.normalized_from_pixels(points), camera.focus_mm).distance

    distance_mm = inside_mm(pixels)
    gradient = np.hypot(*(inside_mm(pixels + step) - distance_mm for step in np.eye(2)))
    return np.asarray(((distance_mm - camera.pupil.radius_mm) / gradient).min(axis=1))


@dataclass(frozen=True)
class BorderBlur:
    """Variance of the blur across the centre of a plane mirror's border, px^2, with its standard deviation.

    `ends` (2, 2) are normalized coordinates just inside and just outside that centre, `spacing_px` pixels apart.
    """

    aperture: Mirror
    variance_px2: float
    sigma_px2: float
    ends: FloatArray
    spacing_px: float

    def px_per_mm(self, inverse_focus: float) -> float:
        """Half width of the pupil's blur, px, per mm of its radius, for `inverse_focus` = 1 / focus."""
        inside, outside = outline_aperture(self.aperture, self.ends, 1.0 / inverse_focus).distance.min(axis=1)
        return self.spacing_px / float(inside - outside)


@dataclass(frozen=True)
class PupilFit:
    """The pupil fitted to the blur of the borders.

    Attributes
    ----------
    square_mm2, square_sigma_mm2
        The squared diameter, whose error is nearly normal down to 0; the estimate may be negative.
    inverse_focus, inverse_focus_sigma
        Inverse of the distance in focus, 1/mm.
    borders
        Number of borders used.
    """

    square_mm2: float
    square_sigma_mm2: float
    inverse_focus: float
    inverse_focus_sigma: float
    borders: int

    @property
    def is_pinhole(self) -> bool:
        """Whether the squared diameter is within three standard deviations of zero."""
        return self.square_mm2 < 3.0 * self.square_sigma_mm2

    @property
    def relative_sigma(self) -> float:
        """Standard deviation of the squared diameter relative to it; infinite if that is not positive."""
        return self.square_sigma_mm2 / self.square_mm2 if self.square_mm2 > 0.0 else np.inf

    @property
    def shows_focus(self) -> bool:
        """Whether the borders, rather than the prior, determine the distance in focus."""
        return not self.is_pinhole and self.inverse_focus_sigma < INVERSE_FOCUS_SIGMA / 2.0

    @property
    def aperture_mm(self) -> float:
        """Diameter of the pupil, mm."""
        return float(np.sqrt(max(self.square_mm2, 0.0)))

    @property
    def aperture_sigma_mm(self) -> float:
        """Increase of the diameter when its square grows by one standard deviation, mm."""
        return float(np.sqrt(max(self.square_mm2, 0.0) + self.square_sigma_mm2)) - self.aperture_mm


@dataclass(frozen=True)
class _Profile:
    """Light and its sigma (n,) at points of a border, with coordinates `tangential` and `normal` (n,) from -1 to 1.

    `inside_mm` (n,) are distances of the edge's image from the pupil's centre, and `mm_per_px` (n,) their derivatives;
    `centre_mm_per_px` is the derivative at the border's centre.
    """

    light: FloatArray
    sigma: FloatArray
    inside_mm: FloatArray
    mm_per_px: FloatArray
    tangential: FloatArray
    normal: FloatArray
    centre_mm_per_px: float

    @classmethod
    def of(cls, layout: Layout, light: BorderLight) -> _Profile:
        border, pupil = light.border, layout.camera.pupil
        normalized = border.normalized(layout)
        shape = normalized.shape[:2]
        planes = outline_aperture(border.aperture, normalized.reshape(-1, 2), pupil.focus_mm)
        nearest, second = (distance.reshape(shape) for distance in np.partition(planes.distance, 1, axis=1)[:, :2].T)
        in_front = np.isfinite(nearest)
        gradient = -np.gradient(np.where(in_front, nearest, 0.0), STEP_PX, axis=1)
        # Skip points where another edge of the outline also crosses the pupil.
        usable = in_front & np.isfinite(light.light) & (second > 1.5 * max(pupil.radius_mm, 1.0))
        tangential = np.broadcast_to(np.linspace(-1.0, 1.0, PROFILES)[:, None], shape)
        normal = np.broadcast_to(border.out_px / border.out_px[-1], shape)
        return cls(
            light=light.light[usable],
            sigma=light.sigma[usable],
            inside_mm=nearest[usable],
            mm_per_px=gradient[usable],
            tangential=tangential[usable],
            normal=normal[usable],
            centre_mm_per_px=float(gradient[shape[0] // 2, shape[1] // 2]),
        )

    @property
    def gain(self) -> float:
        """The light inside the border; 0 if there are too few points on either side."""
        inside = self.normal < INSIDE
        per_side = min(inside.sum(), (self.normal > OUTSIDE).sum())
        enough = len(self.light) >= MIN_POINTS and per_side >= MIN_POINTS_PER_SIDE
        return float(np.median(self.light[inside])) if enough else 0.0

    def residuals(self, p: FloatArray) -> FloatArray:
        """Model minus light in sigmas, for p (6,): light at the centre, its gradient (2), shift, rotation, variance."""
        radius_mm = 2.0 * np.sqrt(p[5] - MIN_LENS_PX**2) * self.centre_mm_per_px
        inside_mm = self.inside_mm + (p[3] + p[4] * self.tangential) * self.mm_per_px
        fraction = sum(
            weight * segment_fraction((inside_mm + MIN_LENS_PX * node * self.mm_per_px) / radius_mm)
            for node, weight in zip(NODES, WEIGHTS / WEIGHTS.sum(), strict=True)
        )
        return np.asarray(((p[0] + p[1] * self.tangential + p[2] * self.normal) * fraction - self.light) / self.sigma)


def border_blur(layout: Layout, light: BorderLight) -> BorderBlur | None:
    """Fit the blur of a border by least squares, with its position and linear light; None if it is too faint."""
    profile = _Profile.of(layout, light)
    gain = profile.gain
    if gain < MIN_CONTRAST:
        return None
    half_px = max(layout.camera.pupil.radius_mm, 0.2) / profile.centre_mm_per_px
    lens_px2 = MIN_LENS_PX**2
    start = np.array([gain, 0.0, 0.0, 0.0, 0.0, lens_px2 + max(half_px, 2.0 * MIN_HALF_WIDTH_PX) ** 2 / 4.0])
    lower_bounds = np.append(np.full(5, -np.inf), lens_px2 + MIN_HALF_WIDTH_PX**2 / 4.0)
    scale = np.array([gain, gain, gain, 1.0, 1.0, start[5]])
    fit = least_squares(
        profile.residuals, start, bounds=(lower_bounds, np.full(6, np.inf)), x_scale=scale, loss="soft_l1", f_scale=3.0
    )
    variance_factor = max(2.0 * fit.cost / (len(profile.light) - len(start)), 1.0)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac + np.diag(1e-12 / scale**2)) * variance_factor
    sigma = float(np.hypot(np.sqrt(covariance[5, 5]), MODEL_PX2))
    row, column = light.border.pixels.shape[0] // 2, light.border.pixels.shape[1] // 2
    ends = light.border.normalized(layout)[row, [column - 1, column + 1]]
    return BorderBlur(light.border.aperture, float(fit.x[5]), sigma, ends, 2.0 * STEP_PX)


def fit_pupil(layout: Layout, lights: Sequence[BorderLight]) -> PupilFit | None:
    """Fit the pupil to the light across the borders of a calibrated layout; None if too few borders are usable.

    Outlying borders are dropped; the scatter of the others scales the covariance.
    """
    blurs = [blur for light in lights if (blur := border_blur(layout, light)) is not None]
    while len(blurs) >= MIN_BORDERS:
        parameters, residuals, covariance = _fit_pupil(layout, blurs)
        limit = OUTLIER_SIGMAS * max(1.4826 * float(np.median(np.abs(residuals))), 1.0)
        kept = [blur for blur, residual in zip(blurs, np.abs(residuals), strict=True) if residual < limit]
        if len(kept) == len(blurs):
            covariance = covariance * max(float(np.square(residuals).sum()) / (len(residuals) - 2), 1.0)
            square_sigma = np.hypot(np.sqrt(covariance[0, 0]), 2.0 * MODEL_RELATIVE * max(parameters[0], 0.0))
            inverse_focus_sigma = float(np.sqrt(covariance[1, 1]))
            return PupilFit(
                float(parameters[0]), float(square_sigma), float(parameters[1]), inverse_focus_sigma, len(blurs)
            )
        blurs = kept
    return None


def _fit_pupil(layout: Layout, blurs: Sequence[BorderBlur]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return squared diameter, 1 / focus and lens blur variance (3,); residuals (n,) in sigmas; and the covariance."""
    prior = np.array([0.0, 1.0 / layout.camera.focus_mm, LENS_PX2[0]])
    prior_weights = np.array([0.0, 1.0 / INVERSE_FOCUS_SIGMA, 1.0 / LENS_PX2[1]])
    variance, sigma = np.array([(blur.variance_px2, blur.sigma_px2) for blur in blurs]).T
    p = np.array([max(layout.camera.aperture_mm, 0.5) ** 2, *prior[1:]])
    step = 1e-6
    for _ in range(STEPS):
        per_mm2, per_mm2_shifted = (
            np.array([blur.px_per_mm(p[1] + offset) ** 2 / 16.0 for blur in blurs]) for offset in (0.0, step)
        )
        derivatives = (
            np.column_stack([per_mm2, p[0] * (per_mm2_shifted - per_mm2) / step, np.ones(len(blurs))]) / sigma[:, None]
        )
        residuals = (variance - p[0] * per_mm2 - p[2]) / sigma
        information = derivatives.T @ derivatives + np.diag(prior_weights**2)
        change = np.linalg.solve(information, derivatives.T @ residuals + prior_weights**2 * (prior - p))
        p = p + change
        p[1] = np.clip(p[1], 1e-6, 0.1)  # beyond a kilometre, or within a centimetre
        if (np.abs(change) < 1e-6 * np.array([1.0, 1e-3, 1.0])).all():
            break
    return p, residuals, np.linalg.inv(information)
