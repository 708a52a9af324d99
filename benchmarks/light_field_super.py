"""Line pairs that super-resolution from nine views resolves: `python -m benchmarks.light_field_super`.

A chart on a plane: a star of sine waves (Siemens; as of ISO 12233), hyperbolic wedges across and down, from .3 to 1
line pairs per pixel of a view, and slanted squares. It is rendered with the light integrated over each pixel, coded as
sRGB, with noise, in 8 bits: by nine ideal views, at five depths, between which shifts by parts of a pixel differ; and,
with --mirrors, in a frame of the mirror camera, which is decoded.

A frequency is resolved where the wave keeps a tenth of its contrast in its true phase, and more than all else that is
there (root mean square), aliasing included; up to where all lower ones are, and no higher than the picture can hold.
Peak signal-to-noise ratios are against what a camera with pixels as fine as the picture's sees of the chart.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.light_field_images import plain
from benchmarks.records import TIMES, Rows, Table, add_json_option, write_record
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.linear_light import levels_from_light, light_from_levels
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, homography, refocus
from tests.optics.light_field.photographs import through_mirror

Picture = NDArray[np.float32]
Method = Callable[[LightField, FocalPlane, float], Picture]

WIDTH_PX, HEIGHT_PX = 240, 200
DEPTHS_MM, MIRROR_DEPTH_MM = (395.0, 405.0, 415.0, 425.0, 435.0), 420.0
LAYOUT = Path("tests/data/fold_90_layout.json")
CONTRAST, LEAST, INNER_PX, SUBSAMPLES = 0.4, 0.1, 8, 6
STAR_PX, STAR_RADIUS_PX, CYCLES = (62.0, 66.0), 50.0, 72
WEDGE_PX, WEDGE_HALF_PX = (20.0, 180.0), 18.0
ACROSS_PX, DOWN_PX = 215.0, 160.0
"""Column of the middle of the wedge of upright lines, and row of that of level ones."""
FINENESS = (0.3, 1.0)
FREQUENCIES = np.arange(0.32, 0.981, 0.02)
"""Line pairs per pixel of a view: it samples .5 without aliasing."""
SCALES = (1.5, 2.0)


def fineness(along: FloatArray) -> FloatArray:
    """Line pairs per px at a place along a wedge, in px."""
    part = (along - WEDGE_PX[0]) / (WEDGE_PX[1] - WEDGE_PX[0])
    return FINENESS[0] + part * (FINENESS[1] - FINENESS[0])


def chart(u: FloatArray, v: FloatArray) -> FloatArray:
    """Light at places of the chart, in px of a view."""
    wave = np.zeros_like(u)
    x, y = u - STAR_PX[0], v - STAR_PX[1]
    radius = np.hypot(x, y)
    star = (radius < STAR_RADIUS_PX) & (radius > CYCLES / (2.0 * np.pi * FINENESS[1]))
    wave[star] = np.cos(CYCLES * np.arctan2(y, x))[star]
    for along, beside in ((v, u - ACROSS_PX), (u, v - DOWN_PX)):
        wedge = (np.abs(beside) < WEDGE_HALF_PX) & (along > WEDGE_PX[0]) & (along < WEDGE_PX[1])
        wave[wedge] = np.cos(2.0 * np.pi * fineness(along) * beside)[wedge]
    light = 0.5 + CONTRAST * wave
    for side, level in ((22.0, 0.1), (13.0, 0.9), (5.0, 0.3)):
        x, y = u - 156.0, v - 66.0
        light[(np.abs(0.98 * x + 0.17 * y) < side) & (np.abs(0.98 * y - 0.17 * x) < side)] = level
    return light


def over_pixels(light: Callable[[FloatArray], FloatArray], scale: float = 1.0) -> FloatArray:
    """Mean over an even grid within each pixel; `light` tells it at an offset of all of them, in px of a view."""
    within = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    offsets = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2) / scale
    return np.asarray(sum(light(offset) for offset in offsets)) / len(offsets)


def true_chart(scale: float) -> FloatArray:
    """Light of the chart in pixels of a picture."""
    u, v = ((np.arange(round(size * scale)) + 0.5) / scale - 0.5 for size in (WIDTH_PX, HEIGHT_PX))
    grid = np.meshgrid(u, v)
    return over_pixels(lambda offset: chart(grid[0] + offset[0], grid[1] + offset[1]), scale)


def coded(light: FloatArray, noise_grey: float) -> NDArray[np.uint8]:
    noise = np.random.default_rng(1).normal(0.0, noise_grey, light.shape)
    return np.rint(np.clip(255.0 * levels_from_light(light.astype(np.float32)) + noise, 0, 255)).astype(np.uint8)


def ideal_views(depth_mm: float, noise_grey: float) -> LightField:
    """Nine views of the chart on the plane at a depth, by exact pinholes."""
    empty = plain(3, 3, WIDTH_PX, HEIGHT_PX)
    plane = FocalPlane.at_depth(empty, depth_mm)
    light = np.empty(empty.weights.shape)
    for index in np.ndindex(3, 3):
        back: FloatArray = np.asarray(np.linalg.inv(homography(empty, index, plane)).T, dtype=np.float64)

        def seen(offset: FloatArray, back: FloatArray = back) -> FloatArray:
            grid = np.concatenate([empty.pixel_grid() + offset, np.ones((HEIGHT_PX, WIDTH_PX, 1))], axis=-1) @ back
            return chart(grid[..., 0] / grid[..., 2], grid[..., 1] / grid[..., 2])

        light[index] = over_pixels(seen)
    return LightField.of(empty, coded(light, noise_grey)[..., None], empty.weights)


def mirror_views(noise_grey: float) -> tuple[LightField, tuple[int, int]]:
    """The chart in a frame of the mirror camera, decoded, and the pixel of the views at which it begins."""
    layout = Layout.load(LAYOUT)
    decoder = Decoder(layout)
    views, camera = decoder.views, layout.camera
    start = (views.width_px - WIDTH_PX) // 2, (views.height_px - HEIGHT_PX) // 2
    pixels = np.stack(np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px)), axis=-1).astype(float)
    origin = views.reference_view_in_rig_mm @ views.view_from_rig.T

    def seen(offset: FloatArray) -> FloatArray:
        rays = camera.unproject(pixels + offset)
        light = np.zeros(rays.shape[:2])
        for mirror in layout.mirrors:
            corners = np.asarray(mirror.usable_normalized, dtype=np.float32)
            hit = _inside(corners, rays)
            leaves, turned = through_mirror(mirror, rays[hit])
            leaves, turned = leaves @ layout.view_from_rig.T, turned @ layout.view_from_rig.T
            at = leaves + turned * ((MIRROR_DEPTH_MM - leaves[:, 2]) / turned[:, 2])[:, None] - origin
            u, v = (views.focal_px * at[:, k] / at[:, 2] + views.centre_px[k] - start[k] for k in (0, 1))
            light[hit] = chart(u, v)
        return light

    frame = coded(over_pixels(seen), noise_grey)
    return decoder.decode(frame), start


def _inside(corners: Picture, rays: FloatArray) -> NDArray[np.bool_]:
    """Rays (h, w, 3) through a convex outline (n, 2) in normalized coordinates."""
    x, y = rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]
    sides = [
        (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
        for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)
    ]
    return np.logical_or(np.min(sides, axis=0) >= 0, np.max(sides, axis=0) <= 0)


def bicubic(light_field: LightField, plane: FocalPlane, scale: float) -> Picture:
    """The central view alone, enlarged."""
    size = round(light_field.width_px * scale), round(light_field.height_px * scale)
    central = light_from_levels(light_field.samples[1, 1])
    return np.asarray(cv2.resize(central, size, interpolation=cv2.INTER_CUBIC), dtype=np.float32)


def shift_and_add(light_field: LightField, plane: FocalPlane, scale: float) -> Picture:
    """Each sample on the nearest pixel of the fine grid, means of those, the rest from the central view enlarged."""
    width, height = round(light_field.width_px * scale), round(light_field.height_px * scale)
    total, count = np.zeros((2, height * width))
    grid = np.concatenate([light_field.pixel_grid(), np.ones((*light_field.weights.shape[2:], 1))], axis=-1)
    for index in np.ndindex(3, 3):
        seen = grid @ np.linalg.inv(homography(light_field, index, plane)).T
        u, v = (np.rint(scale * (seen[..., k] / seen[..., 2] + 0.5) - 0.5).astype(int) for k in (0, 1))
        there = (u >= 0) & (v >= 0) & (u < width) & (v < height) & light_field.valid[index]
        cells = v[there] * width + u[there]
        np.add.at(total, cells, light_from_levels(light_field.samples[index])[..., 0][there])
        np.add.at(count, cells, 1)
    rest = bicubic(light_field, plane, scale).ravel()
    return np.where(count > 0, total / np.maximum(count, 1), rest).astype(np.float32).reshape(height, width)


def ours(light_field: LightField, plane: FocalPlane, scale: float) -> Picture:
    """Refocused at a scale."""
    return light_from_levels(refocus(light_field, plane, scale=scale).image)[..., 0]


def kept(picture: Picture, phase: FloatArray, where: NDArray[np.bool_]) -> tuple[float, float]:
    """Contrast in phase of a wave in a part of a picture, and what else there is, as parts of the chart's contrast."""
    wave = phase[where]
    basis = np.stack([np.ones_like(wave), np.cos(wave), np.sin(wave)], axis=-1)
    values = picture[where].astype(np.float64)
    fit = np.linalg.lstsq(basis, values, rcond=None)[0]
    rest = np.sqrt(np.mean(np.square(values - basis[:, :2] @ fit[:2])) * 2.0)
    return float(fit[1]) / CONTRAST, float(rest) / CONTRAST


def contrasts(picture: Picture, scale: float) -> dict[str, list[tuple[float, float]]]:
    """Contrast and what else there is at each of `FREQUENCIES`, of a picture of the chart."""
    u, v = np.meshgrid(*((np.arange(size) + 0.5) / scale - 0.5 for size in picture.shape[::-1]))
    x, y = u - STAR_PX[0], v - STAR_PX[1]
    radius = np.hypot(x, y)
    found: dict[str, list[tuple[float, float]]] = {"star": [], "across": [], "down": []}
    for frequency in FREQUENCIES:
        ring = np.abs(radius - CYCLES / (2.0 * np.pi * frequency)) < 0.8
        found["star"].append(kept(picture, CYCLES * np.arctan2(y, x), ring))
        for name, along, beside in (("across", v, u - ACROSS_PX), ("down", u, v - DOWN_PX)):
            part = (np.abs(beside) < WEDGE_HALF_PX - 3.0) & (np.abs(fineness(along) - frequency) < 0.012)
            found[name].append(kept(picture, 2.0 * np.pi * fineness(along) * beside, part))
    return found


def resolved(found: list[tuple[float, float]], scale: float) -> float:
    """The frequency up to which all are resolved; none above what a picture holds."""
    highest = 0.0
    for frequency, (signal, rest) in zip(FREQUENCIES, found, strict=True):
        if not (signal >= LEAST and signal > rest and frequency <= 0.5 * scale):
            break
        highest = float(frequency)
    return highest


def psnr(picture: Picture, true: FloatArray) -> float:
    """Of grey levels of sRGB, away from the border."""
    levels = [np.clip(levels_from_light(np.asarray(each, dtype=np.float32)), 0.0, 1.0) for each in (picture, true)]
    return float(
        -10.0 * np.log10(max(1e-15, np.square(levels[0] - levels[1])[INNER_PX:-INNER_PX, INNER_PX:-INNER_PX].mean()))
    )


METHODS: dict[str, Method] = {"bicubic": bicubic, "shift and add": shift_and_add, "refocus --scale": ours}


def _title(method: str, scale: float) -> str:
    """The name of a row; the first of a scale says it."""
    if method == "bicubic":
        return f"{scale:g} {TIMES}: central view, bicubic"
    return f"`refocus --scale {scale:g}`" if method == "refocus --scale" else "shift-and-add"


def judged(
    name: str, light_fields: list[tuple[LightField, float]], start: tuple[int, int], folder: Path | None
) -> Table:
    """Print figures of all methods, of several light fields the median and the worst, and return the table."""
    head = ("star", "wedge across; down", "PSNR, dB", "contrast of the star at .5, .6, .7, .8")
    print(f"{name}: line pairs per px of a view")
    table = Rows("", *head)
    for scale in SCALES:
        true = true_chart(scale)
        for method, made in METHODS.items():
            rows, shown = [], []
            for light_field, depth_mm in light_fields:
                whole = made(light_field, FocalPlane.at_depth(light_field, depth_mm), scale)
                first = tuple(round(scale * each) for each in start)
                picture = whole[first[1] : first[1] + true.shape[0], first[0] : first[0] + true.shape[1]]
                found = contrasts(picture, scale)
                rows.append([resolved(each, scale) for each in found.values()] + [psnr(picture, true)])
                shown.append([found["star"][at][0] for at in (9, 14, 19, 24)])
            middle, worst = np.median(rows, axis=0), np.min(rows, axis=0)
            cells = [f"{one:.2f} ({other:.2f})" for one, other in zip(middle[:3], worst[:3], strict=True)]
            contrast = ", ".join(f"{each:.2f}" for each in np.median(shown, axis=0))
            table.add(
                *(_title(method, scale), cells[0], "; ".join(cells[1:]), f"{middle[3]:.1f} ({worst[3]:.1f})"),
                contrast,
            )
            if folder is not None:
                levels = np.clip(levels_from_light(picture), 0.0, 1.0)
                write_image(
                    folder / f"{name}_{scale:g}_{method.replace(' ', '_')}.png",
                    np.rint(255.0 * levels).astype(np.uint8),
                )
    return table.table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noise-grey", type=float, default=1.0, help="standard deviation of noise, grey levels")
    parser.add_argument("--mirrors", action="store_true", help="also in a frame of the mirror camera, decoded")
    parser.add_argument("--picture", type=Path, metavar="FOLDER", help="folder for pictures of the chart")
    add_json_option(parser)
    options = parser.parse_args()
    if options.picture is not None:
        options.picture.mkdir(parents=True, exist_ok=True)
    every = [(ideal_views(depth_mm, options.noise_grey), depth_mm) for depth_mm in DEPTHS_MM]
    write_record(options.json, "light_field_super", table=judged("views", every, (0, 0), options.picture))
    if options.mirrors:
        light_field, start = mirror_views(options.noise_grey)
        found = judged("mirrors", [(light_field, MIRROR_DEPTH_MM)], start, options.picture)
        last = found.rows[-len(METHODS) :]
        names = ("bicubic", "shift_and_add", f"scale_{SCALES[-1]:g}")
        figures = {f"mirrors_{name}_star": float(row[1].split()[0]) for name, row in zip(names, last, strict=True)}
        figures |= {f"mirrors_{name}_db": float(row[3].split()[0]) for name, row in zip(names, last, strict=True)}
        write_record(options.json, "light_field_super_mirrors", figures)


if __name__ == "__main__":
    main()
