"""Measurement and compensation of each view's brightness relative to the central view, and of the camera's response.

Mirrors differ in reflectance. Towards the border of a view, its mirror fills only a known share s of the pupil. There,
a linear camera records s times the grey level just inside; a camera with a gamma curve records about s^gamma times that
level. Decoding divides by that factor wherever only part of the pupil sees a mirror.
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
# Range of trial depths, in reference distances; beyond the farthest, the parallax hardly changes.
NEAREST_TRIAL, FARTHEST_TRIAL = 0.6, 4.0
MIN_CORRELATION = 0.95
MIN_CONTRAST = 0.02
MIN_PLACES = 40
MIN_GREY, MAX_GREY = 16.0, 250.0
INVISIBLE = 0.03
"""Largest relative difference of brightness that is invisible; equal views are measured to differ by no more."""
LINEAR = 1.0
NEARLY_LINEAR = 0.1
"""Deviation from 1 that a single frame of a linear camera may give: closer exponents count as 1."""
MIN_EXPONENT, MAX_EXPONENT = 0.2, 2.0
MAX_SHARE = 0.9
"""Share of the pupil above which vignetting is too weak to measure."""
MIN_VIGNETTED_GREY, MAX_VIGNETTED_GREY = 10.0, 200.0
OUTLIER = 0.1
"""Difference of logarithms above which two places probably show different surfaces."""
ROUNDS = 20
MIN_VIGNETTED_PLACES = 1000


class Equalisation(Value):
    """Factors (t, s, c) on the samples of each view, one per colour, that make all views as bright as the central one.

    The factors apply to the frames' grey levels, not to linear light: a gamma curve maps a factor to another factor.
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
            raise ValueError("gain lies outside 0.05 to 20, expected mirrors of the same kind")
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
        """Read a file written by `save`; raises InputError in one line."""
        return read_model(cls, path, LARGEST_LAYOUT_BYTES)


def measure(light_fields: Iterable[LightField]) -> Equalisation:
    """Measure the equalisation from light fields of any scene, or of an evenly lit surface.

    Each place of a view is compared with the place of the central view that shows the same point, at the trial depth of
    the highest correlation. Only textured places are used; if too few match, as on a plain wall, places without texture
    are. The factor is the median over the light fields of their medians over places.

    Raises InputError if a view has too few places, the layouts of the light fields differ, or there are no light
    fields.
    """
    ratios: list[list[_Places]] = []
    vignetted: list[VignettedLevels] = []
    views: LightField | None = None
    for light_field in light_fields:
        if views is not None and light_field.layout_identity != views.layout_identity:
            raise InputError(
                f"light field of layout {light_field.layout_identity}, expected {views.layout_identity} of the others"
            )
        views = light_field
        ratios.append(list(_brightness_ratios(light_field)))
        vignetted.append(VignettedLevels.of(light_field))
    if views is None:
        raise InputError("no light field to measure the brightness of views in, expected at least one")
    gain, place_counts = _gain(ratios, views)
    if np.isnan(gain).any():
        t, s = np.argwhere(np.isnan(gain))[0][:2]
        raise InputError(
            f"view ({t}, {s}) has {place_counts[t, s]} places to compare its brightness in, expected {MIN_PLACES}: "
            "give frames of a scene that is neither dark nor overexposed"
        )
    return Equalisation(layout_identity=views.layout_identity, gain=gain, exponent=fit_exponent(vignetted))


def visible_equalisation(light_field: LightField) -> Equalisation | None:
    """Measure the equalisation of one light field; None if no view differs visibly from the central one.

    A view with too few places to compare keeps its brightness.
    """
    if light_field.rows * light_field.cols < 2:
        return None
    gain, _ = _gain([list(_brightness_ratios(light_field))], light_field)
    gain[np.isnan(gain)] = 1.0
    if np.abs(gain - 1.0).max() <= INVISIBLE:
        return None
    return Equalisation(layout_identity=light_field.layout_identity, gain=gain)


def equalised(light_field: LightField, equalisation: Equalisation) -> LightField:
    """Return the light field with equalised views; raises InputError for an equalisation of another layout."""
    equalisation.check_belongs_to(light_field)
    samples = light_field.samples.copy()
    equalisation.apply(samples)
    return LightField.of(light_field, samples, light_field.weights)


def _gain(ratios: Sequence[Sequence[_Places]], views: LightField) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return factors (t, s, c), NaN where places are too few, and the largest number of places (t, s)."""
    gain = np.full((views.rows, views.cols, views.samples.shape[4]), np.nan)
    place_counts = np.zeros(gain.shape[:2], np.intp)
    for number, view in enumerate(np.ndindex(place_counts.shape)):
        chosen = [places[number].chosen for places in ratios]
        place_counts[view] = max((len(each) for each in chosen), default=0)
        medians = [np.median(each, axis=0) for each in chosen if len(each) >= MIN_PLACES]
        if medians:
            gain[view] = np.exp(np.median(medians, axis=0))
    return gain, place_counts


@dataclass(frozen=True)
class _Places:
    """Logarithms (n, c) of the central view's brightness over this view's, at textured and at plain places."""

    textured: FloatArray
    plain: FloatArray

    @property
    def chosen(self) -> FloatArray:
        """The textured places, or the plain ones if there are too few textured ones."""
        return self.textured if len(self.textured) >= MIN_PLACES else self.plain


def _shrunk(light_field: LightField) -> tuple[NDArray[np.float32], NDArray[np.bool_], FloatArray]:
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
        share = np.asarray(cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA))
        usable.append((share > 0.999) & (views[-1] > MIN_GREY).all(axis=2))
    matrices = light_field.matrices.reshape(-1, 3, 3).copy()
    matrices[:, :2] /= shrink
    matrices[:, :2, 2] -= (shrink - 1) / (2 * shrink)
    return np.stack(views), np.stack(usable), matrices


def _brightness_ratios(light_field: LightField) -> Iterator[_Places]:
    """Yield the central view's brightness relative to each view, row by row, where the two can be compared."""
    views, usable, matrices = _shrunk(light_field)
    positions = light_field.positions_mm.reshape(-1, 3)
    central = int(np.flatnonzero((positions == 0).all(axis=1))[0])
    grey = views.mean(axis=3)
    mean, spread = _mean(views), _deviation(grey)
    plain = spread < MIN_CONTRAST * np.maximum(_mean(grey), 1.0)
    windows = np.stack([_valid_windows(each) for each in usable])
    for number in range(len(views)):
        if number == central:
            no_difference = np.zeros((MIN_PLACES, views.shape[3]))
            yield _Places(textured=no_difference, plain=no_difference)
            continue
        best = np.full(grey.shape[1:], -1.0, dtype=np.float32)
        ratio = np.zeros(views.shape[1:], dtype=np.float32)
        for distance in _trial_distances_mm(light_field, matrices[central], positions[number]):
            # Homography from the view to the central view by the plane at that distance.
            plane = np.eye(3)
            plane[:, 2] += positions[number] / (distance - positions[number, 2])
            homography = matrices[central] @ plane @ np.linalg.inv(matrices[number])
            warped = _warped(views[central], homography).reshape(views.shape[1:])
            valid = _valid_windows((_warped(usable[central].astype(np.float32), homography) > 0.999) & usable[number])
            warped_grey = warped.mean(axis=2)
            covariance = _mean(warped_grey * grey[number]) - _mean(warped_grey) * _mean(grey[number])
            correlation = covariance / np.maximum(_deviation(warped_grey) * spread[number], 1e-3)
            improved = valid & (correlation > best)
            best[improved] = correlation[improved]
            ratio[improved] = np.log(np.maximum(_mean(warped)[improved], 1.0) / mean[number][improved])
        textured = (best > MIN_CORRELATION) & ~plain[number]
        flat = plain[number] & plain[central] & windows[number] & windows[central]
        flat_ratio = np.log(np.maximum(mean[central][flat], 1.0) / np.maximum(mean[number][flat], 1.0))
        yield _Places(textured=ratio[textured].astype(np.float64), plain=flat_ratio.astype(np.float64))


def _trial_distances_mm(views: Views, central: FloatArray, position: FloatArray) -> NDArray[np.float64]:
    """Distances of trial planes from the central view, one pixel of disparity apart, near to far."""
    near, far = (1.0 / (ratio * views.reference_distance_mm) for ratio in (NEAREST_TRIAL, FARTHEST_TRIAL))
    shift_px = central[0, 0] * float(np.linalg.norm(position[:2])) * (near - far)
    with np.errstate(divide="ignore"):
        return 1.0 / np.linspace(near, far, max(2, int(np.ceil(shift_px)) + 1))


def _mean(picture: NDArray[Any]) -> NDArray[np.float32]:
    """Means over a window around each pixel of a picture (v, u) or (v, u, c), or of pictures (n, ...)."""
    if picture.ndim == 4 or (picture.ndim == 3 and picture.shape[2] not in (1, 3)):
        return np.stack([_mean(each) for each in picture])
    means = cv2.blur(picture, (WINDOW_PX, WINDOW_PX))
    return np.asarray(means, dtype=np.float32).reshape(picture.shape)


def _deviation(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Standard deviations over the window of `_mean`, for a picture (v, u) or pictures (n, v, u)."""
    if grey.ndim == 3:
        return np.stack([_deviation(each) for each in grey])
    return np.sqrt(np.maximum(_mean(grey * grey) - _mean(grey) ** 2, 0.0))


def _valid_windows(usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (v, u) of the pixels whose complete window is usable."""
    kernel = np.ones((WINDOW_PX, WINDOW_PX), np.uint8)
    eroded = cv2.erode(usable.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(eroded, dtype=bool)


def _warped(picture: NDArray[np.float32], homography: FloatArray) -> NDArray[np.float32]:
    """Resample a picture at the pixels that a homography maps another picture's pixels to; zero outside."""
    size = picture.shape[1], picture.shape[0]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(picture, homography, size, flags=flags), dtype=np.float32)


@dataclass(frozen=True)
class VignettedLevels:
    """Logarithms (n,) of shares of the pupil, and of grey levels over those at the nearest unvignetted pixel."""

    share: FloatArray
    level: FloatArray

    @classmethod
    def of(cls, light_field: LightField) -> Self:
        """Collect the vignetted places of a light field that was decoded as from a linear camera."""
        scale = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
        shares, levels = [np.zeros(0)], [np.zeros(0)]
        for index in np.ndindex(light_field.rows, light_field.cols):
            weights = light_field.weights[index]
            unvignetted = weights == 1.0
            if not unvignetted.any():
                continue
            grey = light_field.samples[index].astype(np.float32).mean(axis=-1) * np.float32(scale)
            inside = np.asarray(cv2.blur(grey, (3, 3))).ravel()[_nearest_in_mask(unvignetted)]
            usable = (weights > 0.0) & (weights < MAX_SHARE)
            for level in (grey * weights, inside):
                usable &= (level > MIN_VIGNETTED_GREY) & (level < MAX_VIGNETTED_GREY)
            shares.append(np.log(weights[usable].astype(np.float64)))
            levels.append(np.log(grey[usable].astype(np.float64) / inside[usable]))
        return cls(np.concatenate(shares), np.concatenate(levels))


def fit_exponent(vignetted: Sequence[VignettedLevels]) -> float:
    """Return the exponent of grey levels over light; 1 if it is close to 1 or too few places show it."""
    share, level = (np.concatenate(each) for each in zip(*((f.share, f.level) for f in vignetted), strict=True))
    if len(share) < MIN_VIGNETTED_PLACES:
        return LINEAR
    slope, weight = 0.0, np.ones(len(share))
    for _ in range(ROUNDS):
        slope = float((weight * share * level).sum() / (weight * share * share).sum())
        weight = 1.0 / (1.0 + np.square((level - slope * share) / OUTLIER))
    return LINEAR if abs(slope) < NEARLY_LINEAR else float(np.clip(LINEAR + slope, MIN_EXPONENT, MAX_EXPONENT))


def _nearest_in_mask(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Flat index (v, u) of the mask pixel nearest to each pixel."""
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros(int(labels.max()) + 1, np.intp)
    places[labels[mask]] = np.flatnonzero(mask)
    return places[labels]
