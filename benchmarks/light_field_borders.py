"""Views against truth towards their borders, and seams there.

`python -m benchmarks.light_field_borders SCENE... [PICTURE]`; PICTURE (.jpg): refocused pictures of the last scene, as
a pinhole (top) and with the pupil, and ten times their errors beside them.

SCENE: folders of `mirrorcam scene`, decoded by the layout as built: as if its camera had a pinhole, and with its pupil.
True views are as soft as lens, focus and lookup make them, and as dark as the lens's corners.

- Views: PSNR where there is a sample, of all views together and the worst, and the part of the views that there is.
- Profile: the same and the mean error, by how far inside the outline of its mirror (negative: outside) a pixel looks.
- Seams, in grey levels: how much the error of a refocused picture, against one of true views with the same weights,
  changes across the border of a view: medians of 4 px on either side; root mean square over views and sides, and the
  largest.
- Depth: errors within 4 px of the border of a view, and elsewhere.

The outermost 3 px of the pictures are left out, where true views are not known to be as soft as the decoded ones.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import PINHOLE
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, homography, refocus
from mirrorcam.render_scenes.tabletop.tabletop_set import MASK, TabletopSet, read_map

SOFTNESS_PX = 0.95
EDGE_PX = 3
STRIP_PX = 4
PROFILE_PX = (-8.0, -4.0, -2.0, 0.0, 2.0, 4.0, 8.0, 12.0, 16.0, 24.0, 1000.0)
FOCI_MM = (310.0, 375.0, 500.0)
FEWEST_PIXELS = 50


@dataclass(frozen=True, eq=False)
class Compared:
    """A decoded frame of a set beside its truth.

    Attributes
    ----------
    light_field
        The decoded frame.
    true
        True views (t, s, v, u, c), 0 to 255.
    inside_px
        How far (t, s, v, u) inside the outline of its mirror each pixel looks, px of the sensor.
    """

    light_field: LightField
    true: FloatArray
    inside_px: FloatArray

    @property
    def error(self) -> FloatArray:
        """Differences (t, s, v, u, c) from the truth, grey levels."""
        return np.asarray(self.light_field.samples - self.true)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Samples (t, s, v, u) that can be compared: those there are, but for the edges of the pictures."""
        return self.light_field.valid & edgeless(self.true.shape[2:4])


def edgeless(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask (v, u) of a picture without its edges."""
    inner = np.zeros(shape, np.bool_)
    inner[EDGE_PX:-EDGE_PX, EDGE_PX:-EDGE_PX] = True
    return inner


def softened(folder: Path, layout: Layout, decoder: Decoder, index: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """A true view (v, u, c) as soft and as dark as the lens makes it, and where (v, u, 2) on the sensor it is."""
    views, camera, model = decoder.views, layout.camera, TabletopSet.load(folder).sensor
    name = f"{index[0]}_{index[1]}"
    picture = read_image(folder / f"truth/views/{name}.png").astype(np.float64)
    depth = np.nan_to_num(read_map(folder / f"truth/depth/{name}.exr", "depth"), posinf=1e4)
    number = index[0] * views.cols + index[1]
    plane = views.plane_points_in_rig(views.reference_depth_mm, views.pixel_grid(), index)
    axial_mm = layout.mirrors[number].image_of(plane)[..., 2] + depth - views.reference_depth_mm
    # A disc of diameter D has the variance D^2 / 16 along each axis.
    disc_px = camera.fx_px * model.aperture_mm * np.abs(1.0 / axial_mm - 1.0 / model.focus_mm)
    sigma_px = np.hypot(SOFTNESS_PX, disc_px / 4.0)
    sigmas = np.linspace(SOFTNESS_PX, max(float(sigma_px.max()), SOFTNESS_PX + 0.01), 8)
    stack = np.stack([cv2.GaussianBlur(picture, (0, 0), float(sigma)) for sigma in sigmas])
    place = (sigma_px - sigmas[0]) / (sigmas[1] - sigmas[0])
    low = np.minimum(place.astype(np.intp), len(sigmas) - 2)
    rows, columns = np.indices(low.shape)
    part = (place - low)[..., None]
    soft = (1.0 - part) * stack[low, rows, columns] + part * stack[low + 1, rows, columns]
    pixels = layout.project(plane, number)
    normalized = (pixels - [camera.cx_px, camera.cy_px]) / [camera.fx_px, camera.fy_px]
    soft *= ((1.0 + np.square(normalized).sum(axis=-1)) ** (-model.vignetting / 2.0))[..., None]
    return np.minimum(soft, 255.0), pixels


def compared(folder: Path, *, with_pupil: bool, margin_px: float = 2.0) -> Compared:
    """The frame of a set, decoded by the layout as built with or without its pupil, beside the truth."""
    layout = Layout.load(folder / "truth/layout.json")
    pupil = TabletopSet.load(folder).sensor.pupil if with_pupil else PINHOLE
    layout = layout.replaced(camera=layout.camera.with_pupil(pupil))
    decoder = Decoder(layout, margin_px=margin_px)
    light_field = decoder.decode(read_image(folder / TabletopSet.load(folder).frame_name))
    true = np.empty(light_field.samples.shape)
    inside_px = np.empty(light_field.weights.shape)
    for number, index in enumerate(np.ndindex(light_field.rows, light_field.cols)):
        true[index], pixels = softened(folder, layout, decoder, index)
        outline = shapely.Polygon(layout.outline_px(number, 64, usable=True))
        shapely.prepare(outline)
        away = shapely.distance(outline.exterior, shapely.points(pixels))
        inside_px[index] = np.where(shapely.contains_xy(outline, *np.moveaxis(pixels, -1, 0)), away, -away)
    return Compared(light_field, true, inside_px)


def decibels(error: FloatArray) -> float:
    """Peak signal-to-noise ratio of errors (...), grey levels."""
    return float(10.0 * np.log10(255.0**2 / np.mean(np.square(error))))


def views(name: str, pair: Compared) -> None:
    """Print how near views are to the truth, and how much there is of them."""
    each = [decibels(pair.error[index][pair.valid[index]]) for index in np.ndindex(pair.valid.shape[:2])]
    print(
        f"  {name:16} {decibels(pair.error[pair.valid]):5.1f} dB, each {min(each):.1f} to {max(each):.1f}; "
        f"{pair.light_field.valid.mean():6.2%} of the views"
    )


def profile(pinhole: Compared, pupil: Compared) -> None:
    """Print errors by the distance from the outline of the mirror."""
    print("  px inside the outline     pixels   as a pinhole           with the pupil      pixels")
    for low, high in pairwise(PROFILE_PX):
        texts = []
        for pair in (pinhole, pupil):
            where = pair.valid & (pair.inside_px >= low) & (pair.inside_px < high)
            count = np.count_nonzero(where)
            error = pair.error[where] if count >= FEWEST_PIXELS else np.full((1, 1), np.nan)
            texts.append((count, f"{decibels(error):5.1f} dB, mean {error.mean():+6.2f}"))
        (before, first), (after, second) = texts
        print(f"  {low:6.0f} to {high:6.0f}       {before:9d}   {first}   {second}   {after:9d}")


def borders(valid: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Masks of the strips on the inner and the outer side of the border of a mask (v, u), on each of its four sides."""
    inner, outer = (cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5) for mask in (valid, ~valid))
    down, across = np.indices(valid.shape) / np.array(valid.shape)[:, None, None] - 0.5
    sides = (np.abs(down) > np.abs(across)) * 2 + ((np.where(np.abs(down) > np.abs(across), down, across)) > 0)
    known = edgeless(valid.shape)
    for side in range(4):
        there = known & (sides == side)
        yield there & valid & (inner <= STRIP_PX), there & ~valid & (outer <= STRIP_PX)


def refocused(pair: Compared, depth_mm: float) -> tuple[NDArray[np.float32], FloatArray]:
    """A refocused picture (v, u, c), 0 to 255, and its differences from that of true views with the same weights."""
    light_field = pair.light_field
    truth = LightField.of(light_field, (pair.true / 255.0).astype(np.float32), light_field.weights)
    plane = FocalPlane.at_depth(light_field, depth_mm)
    found, true = (np.float32(255.0) * refocus(each, plane).image for each in (light_field, truth))
    return found, np.asarray(found - true, dtype=np.float64)


def seams(name: str, pair: Compared) -> None:
    """Print how much the error of refocused pictures changes across the borders of views."""
    light_field = pair.light_field
    size = light_field.width_px, light_field.height_px
    texts = []
    for depth_mm in FOCI_MM:
        error = refocused(pair, depth_mm)[1].mean(axis=-1)
        steps = []
        for index in np.ndindex(light_field.rows, light_field.cols):
            matrix = homography(light_field, index, FocalPlane.at_depth(light_field, depth_mm))
            flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
            shown = np.asarray(cv2.warpPerspective(light_field.weights[index], matrix, size, flags=flags)) > 0
            for inner, outer in borders(shown):
                if min(np.count_nonzero(inner), np.count_nonzero(outer)) >= FEWEST_PIXELS:
                    steps.append(np.median(error[inner]) - np.median(error[outer]))
        texts.append(f"{depth_mm:.0f} mm: {np.sqrt(np.mean(np.square(steps))):.2f}, {np.abs(steps).max():.2f}")
    print(f"  {name:16} " + "; ".join(texts))


def picture(pairs: Iterable[Compared]) -> NDArray[np.uint8]:
    """Refocused pictures of the pairs, one below the other, and ten times their errors about grey beside them."""
    rows = [
        np.hstack([found, 128.0 + 10.0 * error]) for found, error in (refocused(pair, FOCI_MM[1]) for pair in pairs)
    ]
    return np.clip(np.vstack(rows), 0.0, 255.0).astype(np.uint8)


def depth(folder: Path, name: str, pair: Compared) -> None:
    """Print errors of depth beside the borders of views, and elsewhere."""
    light_field = pair.light_field
    t, s = TabletopSet.load(folder).central_view
    found = DepthEstimator(light_field).estimate(light_field)
    truth = read_map(folder / f"truth/depth/{t}_{s}.exr", "depth")
    matte = read_image(folder / f"truth/mask/{t}_{s}.png", grey=True) == MASK["matte"]
    distance = truth - light_field.reference_view_depth_mm
    grid = (light_field.pixel_grid() - light_field.centre_px) / light_field.focal_px
    places = light_field.project_in_view(
        np.concatenate([grid, np.ones((*truth.shape, 1))], axis=-1) * distance[..., None]
    )
    beside = np.zeros(truth.shape, bool)
    for index in np.ndindex(light_field.rows, light_field.cols):
        valid = np.pad(light_field.valid[index], 1).astype(np.uint8)
        away = cv2.distanceTransform(valid, cv2.DIST_L2, 5) + cv2.distanceTransform(1 - valid, cv2.DIST_L2, 5)
        u, v = (places[index].astype(np.float32)[..., axis] + 1.0 for axis in (0, 1))
        flags: Any = {"interpolation": cv2.INTER_NEAREST, "borderMode": cv2.BORDER_CONSTANT, "borderValue": 1e3}
        beside |= cv2.remap(away.astype(np.float32), u, v, **flags) <= STRIP_PX
    texts = []
    for what, where in (("beside borders", beside), ("elsewhere", ~beside)):
        where = where & found.valid & matte & np.isfinite(truth)
        part = (np.abs(found.depth_mm - truth) / truth)[where]
        texts.append(f"{what} {np.median(part):.3%} median, {np.mean(part > 0.02):.2%} off by 2 % ({len(part)} px)")
    print(f"  {name:16} " + "; ".join(texts))


def main(arguments: list[Path]) -> None:
    pictures = [path for path in arguments if path.suffix == ".jpg"]
    pairs: dict[str, Compared] = {}
    for folder in arguments[: len(arguments) - len(pictures)]:
        pinhole, pupil = (compared(folder, with_pupil=with_pupil) for with_pupil in (False, True))
        pairs = {"as a pinhole": pinhole, "with the pupil": pupil}
        rows, cols, height, width = pupil.light_field.weights.shape
        print(f"{folder.name}: {cols}x{rows} views of {width}x{height}")
        for name, pair in pairs.items():
            views(name, pair)
        profile(pinhole, pupil)
        print("  seams of refocused pictures, root mean square and largest, grey levels")
        for name, pair in pairs.items():
            seams(name, pair)
        print("  depth")
        for name, pair in pairs.items():
            depth(folder, name, pair)
    for path in pictures:
        write_image(path, picture(pairs.values()))


if __name__ == "__main__":
    main([Path(each) for each in sys.argv[1:]])
