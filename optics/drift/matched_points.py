"""Scene points matched between the views of a frame: corners of the reference view, tracked into all others.

Views are decoded with the calibrated layout, equalised in brightness and contrast, and matched by Lucas and Kanade's
optical flow with a forward-backward check. Matching does not assume that points lie where the layout expects them, so
a sub-image that moved by several pixels is tracked, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import unvignetted_outline
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.features.align import align
from mirrorcam.optics.light_field.features.keypoints import grey_views
from mirrorcam.optics.light_field.features.patches import WIDE, ImagePyramid, templates
from mirrorcam.optics.light_field.features.slope import ViewGeometry
from mirrorcam.optics.light_field.light_field import Views

IntArray = NDArray[np.int64]

MAX_CORNERS = 500
"""Maximum number of corners of a frame; they are spread over the view."""
MIN_QUALITY = 0.005
"""Minimum strength of a corner, relative to the strongest."""
WINDOW_PX = 15
LEVELS = 4
PATCH_SCALE = 4.0
MIN_CORRELATION = 0.9
MAX_FORWARD_BACKWARD_PX = 0.5
"""Maximum error of forward-backward tracking."""
EQUALISED_PX, NOISE_GREY = 15.0, 4.0
"""Scale over which brightness and contrast are equalised; contrast below which noise is not amplified."""
TEXTURED_GREY = 8.0
"""RMS contrast around a corner above which it counts as textured."""
CELLS = 5
"""Cells along each side of the reference view; errors of points in one cell may be correlated, also between frames."""


@dataclass(frozen=True)
class MatchedPoints:
    """n observations of p scene points in f frames.

    Attributes
    ----------
    point
        Index (n,) of the observed point, ascending from 0.
    view
        Index (n,) of the mirror that shows it.
    pixels
        Pixels (n, 2) on the sensor.
    frame
        Frame (p,) of each point, from 0.
    cell
        Cell (p,) of the reference view that contains each point.
    textured
        Number (f,) of textured corners in the reference view, matched or not.
    """

    point: IntArray
    view: IntArray
    pixels: FloatArray
    frame: IntArray
    cell: IntArray
    textured: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """Concatenate the points of separate frames."""
        starts = np.cumsum([0, *(len(part.frame) for part in parts)])
        return cls(
            point=np.concatenate([part.point + start for part, start in zip(parts, starts[:-1], strict=True)]),
            view=np.concatenate([part.view for part in parts]),
            pixels=np.concatenate([part.pixels for part in parts]),
            frame=np.concatenate([np.full(len(part.frame), k) for k, part in enumerate(parts)]),
            cell=np.concatenate([part.cell for part in parts]),
            textured=np.concatenate([part.textured for part in parts]),
        )

    def where(self, mask: NDArray[np.bool_]) -> Self:
        """The observations selected by a mask (n,), for points that at least two views still see."""
        remains = np.bincount(self.point[mask], minlength=len(self.frame)) >= 2
        rows = mask & remains[self.point]
        numbers = np.cumsum(remains) - 1
        return type(self)(
            numbers[self.point[rows]],
            self.view[rows],
            self.pixels[rows],
            self.frame[remains],
            self.cell[remains],
            self.textured,
        )


class PointMatcher:
    """Matches points between the views of a layout's frames; reuse it for all frames.

    Raises InputError if the views have no common field at the reference depth, as `Decoder` does.
    """

    def __init__(self, layout: Layout, reference_depth_mm: float | None = None) -> None:
        self.layout = layout
        # A pinhole gives the same unvignetted pixels, and its decoding tables take a quarter of the time.
        pinhole = layout.replaced(camera=layout.camera.replaced(aperture_mm=0.0))
        self.decoder = Decoder(pinhole, reference_depth_mm=reference_depth_mm, field="union")
        views = self.decoder.views
        self.reference = int(np.flatnonzero((views.positions_mm.reshape(-1, 3) == 0).all(axis=1))[0])
        valid = (self.decoder.weights > 0.0).astype(np.uint8).reshape(-1, views.height_px, views.width_px)
        valid *= _unvignetted(layout, views)
        padded = [cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=[0]) for mask in valid]
        kernel = np.ones((WINDOW_PX + 2,) * 2, np.uint8)
        self.inner = np.stack([cv2.erode(mask, kernel)[1:-1, 1:-1] for mask in padded]) > 0
        self.geometry = ViewGeometry.of(views)
        inner_px = np.argwhere(self.inner[self.reference])[:, ::-1]
        self.extent = (inner_px.min(axis=0), inner_px.max(axis=0) + 1) if len(inner_px) else (np.zeros(2), np.ones(2))

    def match(self, frame: NDArray[np.uint8]) -> MatchedPoints:
        """The points of one frame of the layout's camera that at least two views see."""
        grey = grey_views(self.decoder.decode(frame))
        images = [_equalised(image) for image in grey]
        start = self._corners(images[self.reference])
        pixels = np.full((len(images), len(start), 2), np.nan)
        if len(start):
            for view, image in enumerate(images):
                if view != self.reference:
                    pixels[view] = _tracked(images[self.reference], image, start)
            pixels = self._aligned(grey, start, pixels)
        return replace(
            self._on_sensor(pixels, start), textured=np.array([_textured_count(grey[self.reference], start)])
        )

    def _aligned(self, grey: NDArray[np.uint8], start: FloatArray, tracked: FloatArray) -> FloatArray:
        """Refine the pixels (views, n, 2) of the patches around corners (n, 2), allowing for slanted surfaces.

        Starts from the tracked pixels or, for corners that were lost, from the prediction of the other views.
        """
        geometry, views = self.geometry, self.decoder.views
        directions, others = geometry.directions(start), np.delete(np.arange(len(grey)), self.reference)
        inverse_distance = _inverse_distances_per_mm(geometry, directions, tracked)
        valid = np.isfinite(inverse_distance)
        predicted = np.stack([geometry.predict(int(view), directions, inverse_distance) for view in others])
        starts = np.where(np.isfinite(tracked[others]), tracked[others], predicted)
        starts[:, ~valid] = np.nan
        starts[~_within(starts, self.inner[others])] = np.nan
        pyramid = ImagePyramid(grey.reshape(views.rows, views.cols, *grey.shape[1:]))
        patches = templates(pyramid, self.reference, start, np.full(len(start), PATCH_SCALE), WIDE)
        distance = 1.0 / np.clip(np.where(valid, inverse_distance, 1e-3), 1e-6, None)
        aligned = align(pyramid, patches, others, starts, geometry.lateral_mm[others], distance)
        pixels = np.full(tracked.shape, np.nan)
        pixels[others] = np.where((aligned.correlation >= MIN_CORRELATION)[..., None], aligned.pixels, np.nan)
        pixels[self.reference] = start
        return pixels

    def _corners(self, image: NDArray[np.uint8]) -> FloatArray:
        """Corners (n, 2) of the reference view, inside its unvignetted part."""
        height, width = image.shape
        min_distance_px = max(np.sqrt(height * width / (4.0 * MAX_CORNERS)), 4.0)
        mask = self.inner[self.reference].astype(np.uint8)
        corners: Any = cv2.goodFeaturesToTrack(image, MAX_CORNERS, MIN_QUALITY, min_distance_px, mask=mask, blockSize=7)
        return np.zeros((0, 2)) if corners is None else np.asarray(corners, dtype=np.float64).reshape(-1, 2)

    def _on_sensor(self, view_pixels: FloatArray, start: FloatArray) -> MatchedPoints:
        """Sensor observations for view pixels (views, n, 2), except those near a view's border."""
        views = self.decoder.views
        inside = _within(view_pixels, self.inner)
        point, view = np.nonzero(inside.T)
        pixels = np.empty((len(point), 2))
        for k in range(len(view_pixels)):
            rows = view == k
            plane = views.plane_points_in_rig(
                views.reference_depth_mm, view_pixels[k, point[rows]], divmod(k, views.cols)
            )
            pixels[rows] = self.layout.project(plane, k)
        low, high = self.extent
        column, row = np.clip(np.floor((start - low) * CELLS / (high - low)).astype(np.int64), 0, CELLS - 1).T
        matches = MatchedPoints(point, view, pixels, np.zeros(len(start), np.int64), row * CELLS + column)
        return matches.where(np.array(np.isfinite(pixels).all(axis=1)))


def _unvignetted(layout: Layout, views: Views) -> NDArray[np.uint8]:
    """Masks (views, v, u) of the unvignetted pixels of views, on the reference plane."""
    masks = np.zeros((len(layout.mirrors), views.height_px, views.width_px), np.uint8)
    for k, mirror in enumerate(layout.mirrors):
        outline = unvignetted_outline(mirror, layout.camera.pupil)
        if len(outline) < 3:
            continue
        centre, forward = mirror.apparent.virtual_centre_in_rig_mm, layout.view_from_rig[2]
        rays = np.column_stack([outline, np.ones(len(outline))]) @ mirror.reflection
        steps = (views.reference_depth_mm - centre @ forward) / (rays @ forward)
        corners = views.project(centre + steps[:, None] * rays)[divmod(k, views.cols)]
        filled: Any = masks[k]
        cv2.fillConvexPoly(filled, np.rint(np.clip(corners, -1e4, 1e4)).astype(np.int32), [1])
    return masks


def _within(pixels: FloatArray, inner: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (views, n) of pixels (views, n, 2) in the inner parts (views, v, u); False for NaN."""
    height, width = inner.shape[1:]
    nearest = np.rint(np.where(np.isfinite(pixels), np.clip(pixels, -1.0, 1e6), -1.0)).astype(np.int64)
    inside = ((nearest >= 0) & (nearest < [width, height])).all(axis=2)
    u, v = np.clip(nearest[..., 0], 0, width - 1), np.clip(nearest[..., 1], 0, height - 1)
    return np.asarray(inside & inner[np.arange(len(inner))[:, None], v, u])


def _inverse_distances_per_mm(geometry: ViewGeometry, directions: FloatArray, tracked: FloatArray) -> FloatArray:
    """Inverse distances (n,) of tracked corners (views, n, 2), the median over views; NaN for untracked corners."""
    by_view = np.full(tracked.shape[:2], np.nan)
    for view in range(len(tracked)):
        if view != geometry.reference:
            slope, offset = geometry.terms(view, tracked[view])
            residual = offset - geometry.focal_px[view] * directions
            by_view[view] = (slope * residual).sum(axis=1) / (slope**2).sum(axis=1)
    valid = np.isfinite(by_view).any(axis=0)
    inverse_distances = np.full(len(directions), np.nan)
    inverse_distances[valid] = np.nanmedian(by_view[:, valid], axis=0)
    return inverse_distances


def _equalised(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Equalise the local brightness and contrast of a grey picture."""
    values: Any = np.float32(image)
    detail = values - cv2.GaussianBlur(values, (0, 0), EQUALISED_PX)
    contrast = np.sqrt(cv2.GaussianBlur(detail**2, (0, 0), EQUALISED_PX)) + np.float32(NOISE_GREY)
    return np.clip(128.0 + 45.0 * detail / contrast, 0.0, 255.0).round().astype(np.uint8)


def _textured_count(image: NDArray[np.uint8], corners: FloatArray) -> int:
    """Number of corners (n, 2) whose surroundings have more contrast than noise."""
    values: Any = np.float32(image)
    window = (WINDOW_PX, WINDOW_PX)
    variance = cv2.blur(values**2, window) - cv2.blur(values, window) ** 2
    u, v = np.clip(corners.round().astype(np.int64), 0, np.array(image.shape[::-1]) - 1).T
    return int((variance[v, u] > TEXTURED_GREY**2).sum())


def _tracked(image: NDArray[np.uint8], other: NDArray[np.uint8], start: FloatArray) -> FloatArray:
    """Pixels (n, 2) of the corners in another view; NaN for corners that fail the forward-backward check."""
    options: dict[str, Any] = {
        "winSize": (WINDOW_PX, WINDOW_PX),
        "maxLevel": LEVELS,
        "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.003),
    }
    points: Any = start.astype(np.float32)[:, None]
    no_guess: Any = None
    tracked, is_tracked, _ = cv2.calcOpticalFlowPyrLK(image, other, points, no_guess, **options)
    back, is_back, _ = cv2.calcOpticalFlowPyrLK(other, image, tracked, no_guess, **options)
    error_px = np.linalg.norm(back[:, 0] - points[:, 0], axis=1)
    valid = (is_tracked[:, 0] > 0) & (is_back[:, 0] > 0) & (error_px < MAX_FORWARD_BACKWARD_PX)
    return np.where(valid[:, None], tracked[:, 0].astype(np.float64), np.nan)
