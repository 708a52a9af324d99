"""The brightness of each view relative to the central one, and the camera's response, measured and compensated.

Mirrors reflect unequally. Towards the border of a view its mirror serves a known share s of the pupil. There a camera
of linear response gives s times the grey level just inside, one with a gamma curve about s to the power of the curve's
exponent: views are brightened by it where only part of the pupil sees them.
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

# Views are compared at a part of their size, a quarter at least: no detail is asked for, and noise averages out.
SHRINK = 4
LEAST_SIDE_PX = 70
WINDOW_PX = 9
# Depths that are tried, in parts of the reference distance; beyond the last, things hardly move any more.
NEAREST, FARTHEST = 0.6, 4.0
LEAST_CORRELATION = 0.95
LEAST_CONTRAST = 0.02
LEAST_PLACES = 40
DARK, BRIGHT = 16.0, 250.0
ALIKE = 0.03
"""Difference of brightness that is not seen, and that views which are alike are measured to differ by at most."""
LINEAR = 1.0
NEARLY_LINEAR = 0.1
"""What one frame of a linear camera gives is no farther from 1: nearer exponents count as 1."""
LEAST, MOST = 0.2, 2.0
MOST_SHARE = 0.9
"""Share above which light hardly falls."""
FADING_DARK, FADING_BRIGHT = 10.0, 200.0
OUTLIER = 0.1
"""Difference of logarithms from which on a place probably shows something else than the one inside."""
ROUNDS = 20
FEWEST_PLACES = 1000


class Equalisation(Value):
    """Factors (t, s, c) on the samples of each view, one per colour, that make all views as bright as the central one.

    They apply to frames as they are, not to linear light: a gamma curve turns factors into others, not into something
    else. `layout_identity` is that of the layout that they were measured with. `exponent` is that of grey levels over
    light, 1 of a linear camera.
    """

    schema_id: Literal["mirrorcam.equalisation/1"] = Field(default="mirrorcam.equalisation/1", alias="schema")
    layout_identity: str
    gain: Annotated[FloatArray, Shaped((None, None, None))]
    exponent: float = Field(default=LINEAR, ge=LEAST, le=MOST, exclude_if=lambda exponent: exponent == LINEAR)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.gain.shape[2] not in (1, 3):
            raise ValueError(f"gain has {self.gain.shape[2]} colours, expected 1 or 3")
        if not ((self.gain > 0.05) & (self.gain < 20.0)).all():
            raise ValueError("gain lies outside 0.05 to 20, expected mirrors of the same kind")
        return self

    def check_belongs_to(self, views: Views) -> None:
        """Raise InputError where the views are of another layout."""
        if self.layout_identity != views.layout_identity:
            raise InputError(
                f"equalisation was measured with layout {self.layout_identity}, expected {views.layout_identity}"
            )
        if self.gain.shape[:2] != (views.rows, views.cols):
            raise InputError(f"equalisation is of {self.gain.shape[:2]} views, expected {(views.rows, views.cols)}")

    def apply(self, samples: Samples) -> None:
        """Multiply samples (t, s, v, u, c) in place; 8-bit ones are rounded, and end at 255."""
        if samples.shape[4] != self.gain.shape[2]:
            raise InputError(f"frame has {samples.shape[4]} colours, expected {self.gain.shape[2]} of the equalisation")
        for view in np.ndindex(samples.shape[:2]):
            # A diagonal matrix: OpenCV's fastest way to a factor per colour.
            cv2.transform(samples[view], np.diag(self.gain[view]), dst=samples[view])

    def save(self, path: Path) -> None:
        """Write the factors as JSON, atomically."""
        write_text(path, self.model_dump_json(indent=1, by_alias=True) + "\n")

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote, or raise InputError in one line."""
        return read_model(cls, path, LARGEST_LAYOUT_BYTES)


def measure(light_fields: Iterable[LightField]) -> Equalisation:
    """The equalisation measured in light fields of anything: a scene, or an evenly lit surface.

    Every place of a view is compared with the place of the central view that shows the same: of many depths, the one at
    which the two correlate best. Textured places that match count; where there are too few, as on a plain wall, those
    without texture. The factor is the median over the light fields of the medians over their places.

    Raises InputError for a view that has too few places to compare, light fields of different layouts, and none at all.
    """
    found: list[list[_Places]] = []
    fading: list[Fading] = []
    views: LightField | None = None
    for light_field in light_fields:
        if views is not None and light_field.layout_identity != views.layout_identity:
            raise InputError(
                f"light field of layout {light_field.layout_identity}, expected {views.layout_identity} of the others"
            )
        views = light_field
        found.append(list(_compared(light_field)))
        fading.append(Fading.of(light_field))
    if views is None:
        raise InputError("no light field to measure the brightness of views in, expected at least one")
    gain, most = _gain(found, views)
    if np.isnan(gain).any():
        t, s = np.argwhere(np.isnan(gain))[0][:2]
        raise InputError(
            f"view ({t}, {s}) has {most[t, s]} places to compare its brightness in, expected {LEAST_PLACES}: "
            "give frames of a scene that is neither dark nor overexposed"
        )
    return Equalisation(layout_identity=views.layout_identity, gain=gain, exponent=measured_exponent(fading))


def unequal(light_field: LightField) -> Equalisation | None:
    """What makes the views of a light field alike, or None where none differs visibly from the central one.

    A view that shows too little to be compared stays as it is.
    """
    if light_field.rows * light_field.cols < 2:
        return None
    gain, _ = _gain([list(_compared(light_field))], light_field)
    gain[np.isnan(gain)] = 1.0
    if np.abs(gain - 1.0).max() <= ALIKE:
        return None
    return Equalisation(layout_identity=light_field.layout_identity, gain=gain)


def matched(light_field: LightField, equalisation: Equalisation) -> LightField:
    """The light field with its views made alike; raises InputError for an equalisation of others."""
    equalisation.check_belongs_to(light_field)
    samples = light_field.samples.copy()
    equalisation.apply(samples)
    return LightField.of(light_field, samples, light_field.weights)


def _gain(found: Sequence[Sequence[_Places]], views: LightField) -> tuple[FloatArray, NDArray[np.intp]]:
    """Factors (t, s, c) by the places of each light field, NaN where they are too few, and how many (t, s) they are."""
    gain = np.full((views.rows, views.cols, views.samples.shape[4]), np.nan)
    most = np.zeros(gain.shape[:2], np.intp)
    for number, view in enumerate(np.ndindex(most.shape)):
        chosen = [places[number].chosen for places in found]
        most[view] = max((len(each) for each in chosen), default=0)
        medians = [np.median(each, axis=0) for each in chosen if len(each) >= LEAST_PLACES]
        if medians:
            gain[view] = np.exp(np.median(medians, axis=0))
    return gain, most


@dataclass(frozen=True)
class _Places:
    """Logarithms (n, c) of how much brighter the central view is, where there is texture and where there is none."""

    textured: FloatArray
    plain: FloatArray

    @property
    def chosen(self) -> FloatArray:
        """Those with texture, which match, or where they are too few, those without."""
        return self.textured if len(self.textured) >= LEAST_PLACES else self.plain


def _small(light_field: LightField) -> tuple[NDArray[np.float32], NDArray[np.bool_], FloatArray]:
    """Views (n, v, u, c) in 0 to 255 at a part of their size, where a whole pixel counts, and matrices (n, 3, 3)."""
    rows, cols, height, width, colours = light_field.samples.shape
    shrink = min(SHRINK, max(1, min(width, height) // LEAST_SIDE_PX))
    size = width // shrink, height // shrink
    scale = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
    views, usable = [], []
    for t, s in np.ndindex(rows, cols):
        view = light_field.samples[t, s, : size[1] * shrink, : size[0] * shrink].astype(np.float32) * scale
        good = (light_field.weights[t, s, : view.shape[0], : view.shape[1]] > 0) & (view < BRIGHT).all(axis=2)
        small = cv2.resize(view, size, interpolation=cv2.INTER_AREA)
        views.append(np.asarray(small, dtype=np.float32).reshape(size[1], size[0], colours))
        share = np.asarray(cv2.resize(good.astype(np.float32), size, interpolation=cv2.INTER_AREA))
        usable.append((share > 0.999) & (views[-1] > DARK).all(axis=2))
    matrices = light_field.matrices.reshape(-1, 3, 3).copy()
    matrices[:, :2] /= shrink
    matrices[:, :2, 2] -= (shrink - 1) / (2 * shrink)
    return np.stack(views), np.stack(usable), matrices


def _compared(light_field: LightField) -> Iterator[_Places]:
    """Brightness of the central view relative to each view, row by row, where the two can be compared."""
    views, usable, matrices = _small(light_field)
    positions = light_field.positions_mm.reshape(-1, 3)
    central = int(np.flatnonzero((positions == 0).all(axis=1))[0])
    grey = views.mean(axis=3)
    mean, spread = _mean(views), _spread(grey)
    plain = spread < LEAST_CONTRAST * np.maximum(_mean(grey), 1.0)
    whole = np.stack([_whole(each) for each in usable])
    for number in range(len(views)):
        if number == central:
            nothing = np.zeros((LEAST_PLACES, views.shape[3]))
            yield _Places(textured=nothing, plain=nothing)
            continue
        best = np.full(grey.shape[1:], -1.0, dtype=np.float32)
        ratio = np.zeros(views.shape[1:], dtype=np.float32)
        for distance in _distances(light_field, matrices[number], matrices[central], positions[number]):
            # From a pixel of the view to the central view's, by the plane at that distance from it.
            plane = np.eye(3)
            plane[:, 2] += positions[number] / (distance - positions[number, 2])
            homography = matrices[central] @ plane @ np.linalg.inv(matrices[number])
            seen = _warped(views[central], homography).reshape(views.shape[1:])
            there = _whole((_warped(usable[central].astype(np.float32), homography) > 0.999) & usable[number])
            seen_grey = seen.mean(axis=2)
            covariance = _mean(seen_grey * grey[number]) - _mean(seen_grey) * _mean(grey[number])
            correlation = covariance / np.maximum(_spread(seen_grey) * spread[number], 1e-3)
            better = there & (correlation > best)
            best[better] = correlation[better]
            ratio[better] = np.log(np.maximum(_mean(seen)[better], 1.0) / mean[number][better])
        textured = (best > LEAST_CORRELATION) & ~plain[number]
        flat = plain[number] & plain[central] & whole[number] & whole[central]
        beside = np.log(np.maximum(mean[central][flat], 1.0) / np.maximum(mean[number][flat], 1.0))
        yield _Places(textured=ratio[textured].astype(np.float64), plain=beside.astype(np.float64))


def _distances(views: Views, matrix: FloatArray, central: FloatArray, position: FloatArray) -> NDArray[np.float64]:
    """Distances of planes from the central view, a pixel of disparity apart, near to far."""
    near, far = 1.0 / (NEAREST * views.reference_distance_mm), 1.0 / (FARTHEST * views.reference_distance_mm)
    moves_px = central[0, 0] * float(np.linalg.norm(position[:2])) * (near - far)
    with np.errstate(divide="ignore"):
        return 1.0 / np.linspace(near, far, max(2, int(np.ceil(moves_px)) + 1))


def _mean(picture: NDArray[Any]) -> NDArray[np.float32]:
    """Means over a window about each pixel of a picture (v, u) or (v, u, c), or of pictures (n, ...)."""
    if picture.ndim == 4 or (picture.ndim == 3 and picture.shape[2] not in (1, 3)):
        return np.stack([_mean(each) for each in picture])
    means = cv2.blur(picture, (WINDOW_PX, WINDOW_PX))
    return np.asarray(means, dtype=np.float32).reshape(picture.shape)


def _spread(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Standard deviations over the same window of a picture (v, u), or of pictures (n, v, u)."""
    if grey.ndim == 3:
        return np.stack([_spread(each) for each in grey])
    return np.sqrt(np.maximum(_mean(grey * grey) - _mean(grey) ** 2, 0.0))


def _whole(usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (v, u) of the pixels around which the whole window is usable."""
    kernel = np.ones((WINDOW_PX, WINDOW_PX), np.uint8)
    eroded = cv2.erode(usable.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(eroded, dtype=bool)


def _warped(picture: NDArray[np.float32], homography: FloatArray) -> NDArray[np.float32]:
    """A picture resampled where a homography sends the pixels of another of its size; zero outside."""
    size = picture.shape[1], picture.shape[0]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(picture, homography, size, flags=flags), dtype=np.float32)


@dataclass(frozen=True)
class Fading:
    """Logarithms (n,) of shares of the pupil, and of grey levels over those of the nearest place with all of it."""

    share: FloatArray
    level: FloatArray

    @classmethod
    def of(cls, light_field: LightField) -> Self:
        """That of a light field brightened as one of a linear camera."""
        scale = 1.0 if light_field.samples.dtype == np.uint8 else 255.0
        shares, levels = [np.zeros(0)], [np.zeros(0)]
        for index in np.ndindex(light_field.rows, light_field.cols):
            weights = light_field.weights[index]
            whole = weights == 1.0
            if not whole.any():
                continue
            grey = light_field.samples[index].astype(np.float32).mean(axis=-1) * np.float32(scale)
            inside = np.asarray(cv2.blur(grey, (3, 3))).ravel()[_nearest(whole)]
            there = (weights > 0.0) & (weights < MOST_SHARE)
            for level in (grey * weights, inside):
                there &= (level > FADING_DARK) & (level < FADING_BRIGHT)
            shares.append(np.log(weights[there].astype(np.float64)))
            levels.append(np.log(grey[there].astype(np.float64) / inside[there]))
        return cls(np.concatenate(shares), np.concatenate(levels))


def measured_exponent(fading: Sequence[Fading]) -> float:
    """Exponent of grey levels over light; 1 where it is hardly another, or there are too few places to measure it."""
    share, level = (np.concatenate(each) for each in zip(*((f.share, f.level) for f in fading), strict=True))
    if len(share) < FEWEST_PLACES:
        return LINEAR
    slope, trust = 0.0, np.ones(len(share))
    for _ in range(ROUNDS):
        slope = float((trust * share * level).sum() / (trust * share * share).sum())
        trust = 1.0 / (1.0 + np.square((level - slope * share) / OUTLIER))
    return LINEAR if abs(slope) < NEARLY_LINEAR else float(np.clip(LINEAR + slope, LEAST, MOST))


def _nearest(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Index (v, u) of the nearest pixel of a mask (v, u)."""
    _, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros(int(labels.max()) + 1, np.intp)
    places[labels[mask]] = np.flatnonzero(mask)
    return places[labels]
