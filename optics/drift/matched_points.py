"""Scene points matched between the views of a frame: corners of the reference view, tracked into all others.

Views are decoded with the calibrated layout, equalised in brightness and contrast, and matched by Lucas and Kanade's
optical flow with a forward-backward check. Matching does not assume that points lie where the layout expects them, so
a mirror that moved by several pixels is tracked, too.
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
from mirrorcam.optics.light_field.features.patches import ImagePyramid, templates
from mirrorcam.optics.light_field.features.slope import ViewGeometry
from mirrorcam.optics.light_field.light_field import Views

IntArray = NDArray[np.int64]

CORNERS = 500
"""Largest number of corners of a frame; they are spread over the view."""
MIN_QUALITY = 0.005
"""Smallest strength of a corner, relative to the strongest."""
WINDOW_PX = 15
LEVELS = 4
PATCH_SCALE = 4.0
MIN_CORRELATION = 0.9
MAX_RETURN_PX = 0.5
"""Largest error of forward-backward tracking."""
EQUALISED_PX, NOISE_GREY = 15.0, 4.0
"""Scale over which brightness and contrast are equalised; contrast below which noise is not amplified."""
CLEAR_GREY = 8.0
"""RMS contrast around a corner above which it is not noise."""
CELLS = 5
"""Cells along each side of the reference view; errors of points in one cell may be correlated, across all frames."""


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
    clear
        Number (f,) of corners with contrast in the reference view, matched or not.
    """

    point: IntArray
    view: IntArray
    pixels: FloatArray
    frame: IntArray
    cell: IntArray
    clear: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

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
            clear=np.concatenate([part.clear for part in parts]),
        )

    def where(self, kept: NDArray[np.bool_]) -> Self:
        """The observations selected by a mask (n,), for points that at least two views still see."""
        seen = np.bincount(self.point[kept], minlength=len(self.frame)) >= 2
        rows = kept & seen[self.point]
        numbers = np.cumsum(seen) - 1
        return type(self)(
            numbers[self.point[rows]], self.view[rows], self.pixels[rows], self.frame[seen], self.cell[seen], self.clear
        )


class PointMatcher:
    """Matches points between the views of a layout's frames; reuse it for all frames.

    Raises InputError if the views have no common field at the reference depth, as `Decoder` does.
    """

    def __init__(self, layout: Layout, reference_depth_mm: float | None = None) -> None:
        self.layout = layout
        # Unvignetted pixels are the same for a pinhole, whose tables take a quarter of the time.
        pinhole = layout.replaced(camera=layout.camera.replaced(aperture_mm=0.0))
        self.decoder = Decoder(pinhole, reference_depth_mm=reference_depth_mm, field="union")
        views = self.decoder.views
        self.reference = int(np.flatnonzero((views.positions_mm.reshape(-1, 3) == 0).all(axis=1))[0])
        clear = (self.decoder.weights > 0.0).astype(np.uint8).reshape(-1, views.height_px, views.width_px)
        clear *= _unvignetted(layout, views)
        framed = [cv2.copyMakeBorder(each, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=[0]) for each in clear]
        kernel = np.ones((WINDOW_PX + 2,) * 2, np.uint8)
        self.inner = np.stack([cv2.erode(each, kernel)[1:-1, 1:-1] for each in framed]) > 0
        self.geometry = ViewGeometry.of(views)
        shown = np.argwhere(self.inner[self.reference])[:, ::-1]
        self.extent = (shown.min(axis=0), shown.max(axis=0) + 1) if len(shown) else (np.zeros(2), np.ones(2))

    def match(self, frame: NDArray[np.uint8]) -> MatchedPoints:
        """The points of one frame of the layout's camera that at least two views see."""
        grey = grey_views(self.decoder.decode(frame))
        images = [_equalised(image) for image in grey]
        start = self._corners(images[self.reference])
        seen = np.full((len(images), len(start), 2), np.nan)
        if len(start):
            for view, image in enumerate(images):
                if view != self.reference:
                    seen[view] = _tracked(images[self.reference], image, start)
            seen = self._aligned(grey, start, seen)
        return replace(self._on_sensor(seen, start), clear=np.array([_clear(grey[self.reference], start)]))

    def _aligned(self, grey: NDArray[np.uint8], start: FloatArray, tracked: FloatArray) -> FloatArray:
        """Refine the pixels (views, n, 2) of the patches around corners (n, 2), allowing for slanted surfaces.

        Starts from the tracked pixels or, for corners that were lost, from the prediction of the other views.
        """
        geometry, views = self.geometry, self.decoder.views
        directions, others = geometry.directions(start), np.delete(np.arange(len(grey)), self.reference)
        inverse = _inverse_mm(geometry, directions, tracked)
        known = np.isfinite(inverse)
        predicted = np.stack([geometry.predict(int(view), directions, inverse) for view in others])
        starts = np.where(np.isfinite(tracked[others]), tracked[others], predicted)
        starts[:, ~known] = np.nan
        starts[~_within(starts, self.inner[others])] = np.nan
        pyramid = ImagePyramid(grey.reshape(views.rows, views.cols, *grey.shape[1:]))
        patches = templates(pyramid, self.reference, start, np.full(len(start), PATCH_SCALE))
        distance = 1.0 / np.clip(np.where(known, inverse, 1e-3), 1e-6, None)
        aligned = align(pyramid, patches, others, starts, geometry.lateral_mm[others], distance)
        seen = np.full(tracked.shape, np.nan)
        seen[others] = np.where((aligned.correlation >= MIN_CORRELATION)[..., None], aligned.pixels, np.nan)
        seen[self.reference] = start
        return seen

    def _corners(self, image: NDArray[np.uint8]) -> FloatArray:
        """Corners (n, 2) of the reference view, inside its unvignetted part."""
        height, width = image.shape
        min_distance_px = max(np.sqrt(height * width / (4.0 * CORNERS)), 4.0)
        mask = self.inner[self.reference].astype(np.uint8)
        found: Any = cv2.goodFeaturesToTrack(image, CORNERS, MIN_QUALITY, min_distance_px, mask=mask, blockSize=7)
        return np.zeros((0, 2)) if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 2)

    def _on_sensor(self, seen: FloatArray, start: FloatArray) -> MatchedPoints:
        """Observations on the sensor of pixels (views, n, 2) of views, except those near a view's border."""
        views = self.decoder.views
        inside = _within(seen, self.inner)
        point, view = np.nonzero(inside.T)
        pixels = np.empty((len(point), 2))
        for k in range(len(seen)):
            rows = view == k
            plane = views.plane_points_in_rig(views.reference_depth_mm, seen[k, point[rows]], divmod(k, views.cols))
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
        start, forward = mirror.apparent.virtual_centre_in_rig_mm, layout.view_from_rig[2]
        rays = np.column_stack([outline, np.ones(len(outline))]) @ mirror.reflection
        reach = (views.reference_depth_mm - start @ forward) / (rays @ forward)
        corners = views.project(start + reach[:, None] * rays)[divmod(k, views.cols)]
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


def _inverse_mm(geometry: ViewGeometry, directions: FloatArray, seen: FloatArray) -> FloatArray:
    """Inverse distances (n,) of tracked corners (views, n, 2), the median over views; NaN for untracked corners."""
    each = np.full(seen.shape[:2], np.nan)
    for view in range(len(seen)):
        if view != geometry.reference:
            along, offset = geometry.terms(view, seen[view])
            residual = offset - geometry.focal_px[view] * directions
            each[view] = (along * residual).sum(axis=1) / (along**2).sum(axis=1)
    known = np.isfinite(each).any(axis=0)
    inverse = np.full(len(directions), np.nan)
    inverse[known] = np.nanmedian(each[:, known], axis=0)
    return inverse


def _equalised(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Equalise the local brightness and contrast of a grey picture."""
    values: Any = np.float32(image)
    detail = values - cv2.GaussianBlur(values, (0, 0), EQUALISED_PX)
    contrast = np.sqrt(cv2.GaussianBlur(detail**2, (0, 0), EQUALISED_PX)) + np.float32(NOISE_GREY)
    return np.clip(128.0 + 45.0 * detail / contrast, 0.0, 255.0).round().astype(np.uint8)


def _clear(image: NDArray[np.uint8], corners: FloatArray) -> int:
    """Number of corners (n, 2) whose surroundings have more contrast than noise."""
    values: Any = np.float32(image)
    window = (WINDOW_PX, WINDOW_PX)
    variance = cv2.blur(values**2, window) - cv2.blur(values, window) ** 2
    u, v = np.clip(corners.round().astype(np.int64), 0, np.array(image.shape[::-1]) - 1).T
    return int((variance[v, u] > CLEAR_GREY**2).sum())


def _tracked(image: NDArray[np.uint8], other: NDArray[np.uint8], start: FloatArray) -> FloatArray:
    """Pixels (n, 2) of the corners in another view; NaN for corners that fail the forward-backward check."""
    options: dict[str, Any] = {
        "winSize": (WINDOW_PX, WINDOW_PX),
        "maxLevel": LEVELS,
        "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.003),
    }
    points: Any = start.astype(np.float32)[:, None]
    no_guess: Any = None
    there, found, _ = cv2.calcOpticalFlowPyrLK(image, other, points, no_guess, **options)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(other, image, there, no_guess, **options)
    error_px = np.linalg.norm(back[:, 0] - points[:, 0], axis=1)
    ok = (found[:, 0] > 0) & (returned[:, 0] > 0) & (error_px < MAX_RETURN_PX)
    return np.where(ok[:, None], there[:, 0].astype(np.float64), np.nan)
