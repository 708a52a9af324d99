"""Measurement and compensation of each view's brightness relative to the central view, and of the camera's response.

Mirrors differ in reflectance. Towards the border of a view, its mirror fills only a known fraction s of the pupil; a
linear camera then records s times the grey level just inside, one with a gamma curve about s^gamma times that level.
Decoding divides by that factor wherever only part of the pupil sees a mirror.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_model, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Shaped, Value
from mirrorcam.optics.light_field.light_field import LightField, Samples, Views

# Views are compared at reduced size, at least a quarter: detail is not needed, and noise averages out.
SHRINK = 4
MIN_SIDE_PX = 70
WINDOW_PX = 9
# Range of candidate depths, as multiples of the reference distance; beyond it, the parallax hardly changes.
NEAREST_CANDIDATE, FARTHEST_CANDIDATE = 0.6, 4.0
MIN_CORRELATION = 0.95
MIN_CONTRAST = 0.02
MIN_PIXELS = 40
MIN_GREY, MAX_GREY = 16.0, 250.0
MAX_INVISIBLE = 0.03
"""Maximum relative difference in brightness that is invisible; views of equal brightness measure within it."""
LINEAR = 1.0
LINEAR_TOLERANCE = 0.1
"""Maximum deviation from 1 that a single frame of a linear camera may give: closer exponents count as 1."""
MIN_EXPONENT, MAX_EXPONENT = 0.2, 2.0
MAX_VIGNETTED_FRACTION = 0.9
"""Fraction of the pupil above which vignetting is too weak to measure."""
MIN_VIGNETTED_GREY, MAX_VIGNETTED_GREY = 10.0, 200.0
OUTLIER = 0.1
"""Difference of logarithms above which two pixels probably show different surfaces."""
ROUNDS = 20
MIN_VIGNETTED_PIXELS = 1000


class Equalisation(Value):
    """Factors (t, s, c) on the samples of each view, one per colour, that make all views as bright as the central one.

    The factors apply to the frames' grey levels, not to linear light: a gamma curve changes the factor.
    `layout_identity` names the layout used for the measurement. `exponent` is the exponent of grey levels over light: 1
    for a linear camera.
    """

    schema_id: Literal["mirrorcam.equalisation/1"] = Field(default="mirrorcam.equalisation/1", alias="schema")
    layout_identity: str
    gain: Annotated[FloatArray, Shaped((None, None, None))]
    exponent: float = Field(
        default=LINEAR, ge=MIN_EXPONENT, le=MAX_EXPONENT, exclude_if=lambda exponent: exponent == LINEAR
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.gain.shape[2] not in (1, 3):
            raise ValueError(f"gain has {self.gain.shape[2]} colours, expected 1 or 3")
        if not ((self.gain > 0.05) & (self.gain < 20.0)).all():
            raise ValueError("gain must lie within 0.05 to 20: are the mirrors of the same kind?")
        return self

    def check_belongs_to(self, views: Views) -> None:
        """Raise InputError if the views belong to another layout."""
        if self.layout_identity != views.layout_identity:
            raise InputError(
                f"equalisation was measured with layout {self.layout_identity}, expected {views.layout_identity}"
            )
        if self.gain.shape[:2] != (views.rows, views.cols):
            raise InputError(f"equalisation has {self.gain.shape[:2]} views, expected {(views.rows, views.cols)}")

    def apply(self, samples: Samples) -> None:
        """Multiply samples (t, s, v, u, c) in place; 8-bit samples are rounded and saturate at 255."""
        if samples.shape[4] != self.gain.shape[2]:
            raise InputError(f"frame has {samples.shape[4]} colours, expected {self.gain.shape[2]} of the equalisation")
        for view in np.ndindex(samples.shape[:2]):
            # A diagonal matrix is OpenCV's fastest form of one factor per colour.
            cv2.transform(samples[view], np.diag(self.gain[view]), dst=samples[view])

    def save(self, path: Path) -> None:
        """Write the factors as JSON, atomically."""
        write_text(path, self.model_dump_json(indent=1, by_alias=True) + "\n")

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file written by `save`; raises a one-line InputError."""
        return read_model(cls, path, LARGEST_LAYOUT_BYTES)


def measure(light_fields: Iterable[LightField]) -> Equalisation:
    """Measure the equalisation from light fields of any scene, or of an evenly lit surface.

    Each pixel of a view is compared with the position in the central view that shows the same point, at the candidate
    depth of the highest correlation. Only textured pixels are used, or plain ones if too few match, as on a plain wall.
    The factor is the median over the light fields of their medians over pixels.

    Raises InputError if a view has too few such pixels, the layouts of the light fields differ, or there are no light
    fields.
    """
    ratios: list[list[_BrightnessRatios]] = []
    vignetted: list[VignettedLevels] = []
    views: LightField | None = None
    for light_field in light_fields:
        if views is not None and light_field.layout_identity != views.layout_identity:
            raise InputError(
                f"light field of layout {light_field.layout_identity}, expected {views.layout_identity} like the others"
            )
        views = light_field
        ratios.append(list(_brightness_ratios(light_field)))
        vignetted.append(VignettedLevels.of(light_field))
    if views is None:
        raise InputError("no light field, expected at least one to measure the brightness of views")
    gain, pixel_counts = _gain(ratios, views)
    if np.isnan(gain).any():
        t, s = np.argwhere(np.isnan(gain))[0][:2]
        raise InputError(
            f"view ({t}, {s}) has {pixel_counts[t, s]} px to compare brightness in, expected {MIN_PIXELS} px or more: "
            "give frames of a scene that is neither dark nor overexposed"
        )
    return Equalisation(layout_identity=views.layout_identity, gain=gain, exponent=fit_exponent(vignetted))


def needed_equalisation(light_field: LightField) -> Equalisation | None:
    """Measure the equalisation of one light field; None if no view differs visibly from the central one.

    A view with too few pixels to compare keeps its brightness.
    """
    if light_field.rows * light_field.cols < 2:
        return None
    gain, _ = _gain([list(_brightness_ratios(light_field))], light_field)
    gain[np.isnan(gain)] = 1.0
    if np.abs(gain - 1.0).max() <= MAX_INVISIBLE:
        return None
    return Equalisation(layout_identity=light_field.layout_identity, gain=gain)


def equalised(light_field: LightField, equalisation: Equalisation) -> LightField:
    """Return the light field with equalised views; raises InputError for an equalisation of a different layout."""
    equalisation.check_belongs_to(light_field)
    samples = light_field.samples.copy()
    equalisation.apply(samples)
    return LightField.of(light_field, samples, light_field.weights)


def _gain(ratios: Sequence[Sequence[_BrightnessRatios]], views: LightField) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return factors (t, s, c), NaN where pixels are too few, and the maximum number of pixels (t, s)."""
    gain = np.full((views.rows, views.cols, views.samples.shape[4]), np.nan)
    pixel_counts = np.zeros(gain.shape[:2], np.intp)
    for index, view in enumerate(np.ndindex(pixel_counts.shape)):
        chosen = [view_ratios[index].chosen for view_ratios in ratios]
        pixel_counts[view] = max((len(logs) for logs in chosen), default=0)
        medians = [np.median(logs, axis=0) for logs in chosen if len(logs) >= MIN_PIXELS]
        if medians:
            gain[view] = np.exp(np.median(medians, axis=0))
    return gain, pixel_counts


@dataclass(frozen=True)
class _BrightnessRatios:
    """Logarithms (n, c) of the central view's brightness over this view's, at textured and at plain pixels."""

    textured: FloatArray
    plain: FloatArray

    @property
    def chosen(self) -> FloatArray:
        """The textured pixels, or the plain ones if there are too few textured ones."""
        return self.textured if len(self.textured) >= MIN_PIXELS else self.plain


def _shrink_views(light_field: LightField) -> tuple[NDArray[np.float32], NDArray[np.bool_], FloatArray]:
    """Return shrunk views (n, v, u, c) from 0 to 255, masks of fully valid pixels, and matrices (n, 3, 3)."""
    rows, cols, height, width, colours = light_field.samples.shape
    shrink = min(SHRINK, max(1, min(width, height) // MIN_SIDE_PX))
    size = width // shrink, height // shrink
    scale = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
    views, usable = [], []
    for t, s in np.ndindex(rows, cols):
        view = light_field.samples[t, s, : size[1] * shrink, : size[0] * shrink].astype(np.float32) * scale
        valid = (light_field.weights[t, s, : view.shape[0], : view.shape[1]] > 0) & (view < MAX_GREY).all(axis=2)
        small = cv2.resize(view, size, interpolation=cv2.INTER_AREA)
        views.append(np.asarray(small, dtype=np.float32).reshape(size[1], size[0], colours))
        fraction = np.asarray(cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA))
        usable.append((fraction > 0.999) & (views[-1] > MIN_GREY).all(axis=2))
    matrices = light_field.matrices.reshape(-1, 3, 3).copy()
    matrices[:, :2] /= shrink
    matrices[:, :2, 2] -= (shrink - 1) / (2 * shrink)
    return np.stack(views), np.stack(usable), matrices


def _brightness_ratios(light_field: LightField) -> Iterator[_BrightnessRatios]:
    """Yield the central view's brightness relative to each view, row by row, where the two can be compared."""
    views, usable, matrices = _shrink_views(light_field)
    positions = light_field.positions_mm.reshape(-1, 3)
    central = int(np.flatnonzero((positions == 0).all(axis=1))[0])
    grey = views.mean(axis=3)
    mean, deviation = _mean(views), _deviation(grey)
    plain = deviation < MIN_CONTRAST * np.maximum(_mean(grey), 1.0)
    windows = np.stack([_valid_windows(mask) for mask in usable])
    for index in range(len(views)):
        if index == central:
            no_difference = np.zeros((MIN_PIXELS, views.shape[3]))
            yield _BrightnessRatios(textured=no_difference, plain=no_difference)
            continue
        best = np.full(grey.shape[1:], -1.0, dtype=np.float32)
        ratio = np.zeros(views.shape[1:], dtype=np.float32)
        for distance in _candidate_distances_mm(light_field, matrices[central], positions[index]):
            # Homography from the view to the central view by the plane at that distance.
            plane = np.eye(3)
            plane[:, 2] += positions[index] / (distance - positions[index, 2])
            homography = matrices[central] @ plane @ np.linalg.inv(matrices[index])
            warped = _warped(views[central], homography).reshape(views.shape[1:])
            valid = _valid_windows((_warped(usable[central].astype(np.float32), homography) > 0.999) & usable[index])
            warped_grey = warped.mean(axis=2)
            covariance = _mean(warped_grey * grey[index]) - _mean(warped_grey) * _mean(grey[index])
            correlation = covariance / np.maximum(_deviation(warped_grey) * deviation[index], 1e-3)
            improved = valid & (correlation > best)
            best[improved] = correlation[improved]
            ratio[improved] = np.log(np.maximum(_mean(warped)[improved], 1.0) / mean[index][improved])
        textured = (best > MIN_CORRELATION) & ~plain[index]
        flat = plain[index] & plain[central] & windows[index] & windows[central]
        flat_ratio = np.log(np.maximum(mean[central][flat], 1.0) / np.maximum(mean[index][flat], 1.0))
        yield _BrightnessRatios(textured=ratio[textured].astype(np.float64), plain=flat_ratio.astype(np.float64))


def _candidate_distances_mm(views: Views, central: FloatArray, position: FloatArray) -> NDArray[np.float64]:
    """Return the distances of candidate planes from the central view, one pixel of disparity apart, near to far."""
    near, far = (1.0 / (ratio * views.reference_distance_mm) for ratio in (NEAREST_CANDIDATE, FARTHEST_CANDIDATE))
    shift_px = central[0, 0] * float(np.linalg.norm(position[:2])) * (near - far)
    with np.errstate(divide="ignore"):
        return 1.0 / np.linspace(near, far, max(2, int(np.ceil(shift_px)) + 1))


def _mean(picture: NDArray[Any]) -> NDArray[np.float32]:
    """Return means over a window around each pixel of a picture (v, u) or (v, u, c), or of pictures (n, ...)."""
    if picture.ndim == 4 or (picture.ndim == 3 and picture.shape[2] not in (1, 3)):
        return np.stack([_mean(part) for part in picture])
    means = cv2.blur(picture, (WINDOW_PX, WINDOW_PX))
    return np.asarray(means, dtype=np.float32).reshape(picture.shape)


def _deviation(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return standard deviations over the window of `_mean`, for a picture (v, u) or pictures (n, v, u)."""
    if grey.ndim == 3:
        return np.stack([_deviation(part) for part in grey])
    return np.sqrt(np.maximum(_mean(grey * grey) - _mean(grey) ** 2, 0.0))


def _valid_windows(usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask (v, u) of the pixels whose complete window is usable."""
    kernel = np.ones((WINDOW_PX, WINDOW_PX), np.uint8)
    eroded = cv2.erode(usable.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(eroded, dtype=bool)


def _warped(picture: NDArray[np.float32], homography: FloatArray) -> NDArray[np.float32]:
    """Resample a picture at the positions to which a homography maps the pixels of another; zero outside."""
    size = picture.shape[1], picture.shape[0]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(picture, homography, size, flags=flags), dtype=np.float32)


@dataclass(frozen=True)
class VignettedLevels:
    """Logarithms (n,) of fractions of the pupil, and of grey levels over those at the nearest unvignetted pixel."""

    fraction: FloatArray
    level: FloatArray

    @classmethod
    def of(cls, light_field: LightField) -> Self:
        """Collect the vignetted pixels of a light field that was decoded as if from a linear camera."""
        scale = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
        fractions, levels = [np.zeros(0)], [np.zeros(0)]
        for index in np.ndindex(light_field.rows, light_field.cols):
            weights = light_field.weights[index]
            unvignetted = weights == 1.0
            if not unvignetted.any():
                continue
            grey = light_field.samples[index].astype(np.float32).mean(axis=-1) * np.float32(scale)
            unvignetted_grey = np.asarray(cv2.blur(grey, (3, 3))).ravel()[_nearest_in_mask(unvignetted)]
            usable = (weights > 0.0) & (weights < MAX_VIGNETTED_FRACTION)
            for level in (grey * weights, unvignetted_grey):
                usable &= (level > MIN_VIGNETTED_GREY) & (level < MAX_VIGNETTED_GREY)
            fractions.append(np.log(weights[usable].astype(np.float64)))
            levels.append(np.log(grey[usable].astype(np.float64) / unvignetted_grey[usable]))
        return cls(np.concatenate(fractions), np.concatenate(levels))


def fit_exponent(vignetted: Sequence[VignettedLevels]) -> float:
    """Return the exponent of grey levels over light; 1 if it is close to 1 or measured in too few pixels."""
    fraction, level = (np.concatenate(logs) for logs in zip(*((v.fraction, v.level) for v in vignetted), strict=True))
    if len(fraction) < MIN_VIGNETTED_PIXELS:
        return LINEAR
    slope, weight = 0.0, np.ones(len(fraction))
    for _ in range(ROUNDS):
        slope = float((weight * fraction * level).sum() / (weight * fraction * fraction).sum())
        weight = 1.0 / (1.0 + np.square((level - slope * fraction) / OUTLIER))
    return LINEAR if abs(slope) < LINEAR_TOLERANCE else float(np.clip(LINEAR + slope, MIN_EXPONENT, MAX_EXPONENT))


def _nearest_in_mask(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the flat index (v, u) of the mask pixel nearest to each pixel."""
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    indices = np.zeros(int(labels.max()) + 1, np.intp)
    indices[labels[mask]] = np.flatnonzero(mask)
    return indices[labels]
