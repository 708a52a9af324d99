"""Profiles across borders of mirrors, by both renderers and by rays: `python -m benchmarks.render_borders [PICTURE]`.

The oracle is independent of the renderers: in float64, it follows rays from all over the pupil through each pixel to
the nearest mirror that they meet within its outline (`truth.light_rays`), and on to the squares of a checkerboard,
whose colour it knows by counting squares. Strips of pixels run from the mirror in the middle of the default layout to
those beside and above it, for checkerboards at several places and distances, and one white board. All is light before
lens blur and noise.

For each sensor, strip and renderer, against the oracle:

- before the white board, where there is nothing but the edges: the largest error of the profile;
- before checkerboards: the largest error of the mean profile over them, the RMS of single profiles;
- the variance of pixels over the checkerboards: the least and the greatest ratio, of 4 px each.

PICTURE (.png): the profiles before the white board and before one checkerboard, and the ratio of variances.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.optics.geometry.targets import Checkerboard
from mirrorcam.optics.geometry.transforms import inverse, rigid
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorName
from mirrorcam.render_scenes.truth.light_rays import reflected

SHOWN: tuple[SensorName, ...] = ("c920", "poor")
BOARD = Checkerboard(cols=40, rows=30, square_mm=11.0)
WHITE = Checkerboard(cols=4, rows=3, square_mm=2000.0)
PAPER, INK = 1.0, 0.0
LONG_PX, WIDE_PX = 80, 4
BOARDS = 16
DEPTHS_MM = (300.0, 500.0)
FINE = 4
"""Places along each side of a pixel from which the oracle's rays come."""
ORACLE_RAYS = 144
"""From all over the pupil through each of them."""
REFERENCE_SPP = 2048
GROUP = 4
LEAST_VARIANCE = 0.002
RENDERERS = ("reference", "fast")

Crop = tuple[int, int, int, int]


@dataclass(frozen=True)
class Strip:
    """Pixels x, y, width, height across a border, and whether it lies along rows."""

    name: str
    crop: Crop

    @property
    def along(self) -> int:
        """Axis (0: y, 1: x) of a picture across the border."""
        return 1 if self.crop[2] == LONG_PX else 0

    def profile(self, picture: FloatArray) -> FloatArray:
        """Mean (..., LONG_PX) over the strip's width of pixels (..., h, w)."""
        return np.asarray(picture.mean(axis=-1 - self.along if self.along == 0 else -2))


@dataclass(frozen=True)
class Rays:
    """Rays (p, r) of the pixels of a strip after the mirrors: points, directions, whether there is a mirror."""

    start: FloatArray
    along: FloatArray
    met: NDArray[np.bool_]


def strips(layout: Layout) -> list[Strip]:
    """Strips across the borders of the mirror in the middle."""
    outlines = [layout.outline_px(index) for index in range(len(layout.mirrors))]
    middles = np.array([outline.mean(axis=0) for outline in outlines])
    size = np.array([layout.camera.width_px, layout.camera.height_px]) / 2.0
    home = int(np.linalg.norm(middles - size, axis=1).argmin())
    found = []
    for name, axis in (("beside", 0), ("above", 1)):
        away = middles - middles[home]
        ahead = away[:, axis] if axis == 0 else -away[:, axis]
        near = np.where((ahead > 50.0) & (np.abs(away[:, 1 - axis]) < ahead), ahead, np.inf)
        other = int(near.argmin())
        sign = 1.0 if axis == 0 else -1.0
        edges = [
            np.sort(sign * outlines[which][:, axis])[order].mean()
            for which, order in ((home, slice(-2, None)), (other, slice(0, 2)))
        ]
        at = np.zeros(2)
        at[axis] = sign * np.mean(edges)
        at[1 - axis] = (middles[home][1 - axis] + middles[other][1 - axis]) / 2.0 + 25.0
        wide = np.array([LONG_PX, WIDE_PX]) if axis == 0 else np.array([WIDE_PX, LONG_PX])
        corner = np.round(at - wide / 2.0).astype(int)
        found.append(Strip(name, (int(corner[0]), int(corner[1]), int(wide[0]), int(wide[1]))))
    return found


def poses(layout: Layout, count: int) -> list[FloatArray]:
    """Rigid poses (4, 4), rig_from_board, mm, of boards before the device at different places, turns and distances."""
    random = np.random.default_rng(5)
    turn = layout.view_from_rig.T
    found = []
    for depth in np.linspace(*DEPTHS_MM, count):
        angle, slope = random.uniform(-0.5, 0.5), random.uniform(-0.3, 0.3)
        c, s = np.cos(angle), np.sin(angle)
        cs, ss = np.cos(slope), np.sin(slope)
        own = turn @ np.array([[cs, 0, ss], [0, 1, 0], [-ss, 0, cs]]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        half = np.array([BOARD.cols, BOARD.rows, 0.0]) * BOARD.square_mm / 2.0
        half[:2] += random.uniform(-11.0, 11.0, 2)
        found.append(rigid(own, depth * turn[:, 2] - own @ half))
    return found


def disc(count: int, turned: float) -> FloatArray:
    """Points (count, 2) spread evenly over the unit disc."""
    number = np.arange(count)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * number + turned
    return np.asarray(np.sqrt((number + 0.5) / count)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def traced(layout: Layout, crop: Crop, pupil: Pupil) -> Rays:
    """Follow the oracle's rays of a strip to the last mirror that each meets."""
    x, y, width, height = crop
    fine = (np.arange(FINE) + 0.5) / FINE - 0.5
    columns, rows = np.meshgrid(np.arange(x, x + width), np.arange(y, y + height))
    bundles = []
    for number, (down, right) in enumerate(np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)):
        px = np.column_stack([columns.ravel() + right, rows.ravel() + down])
        chief = layout.camera.unproject(px)
        chief = chief / chief[:, 2:]
        lens = pupil.radius_mm * disc(ORACLE_RAYS, 2.0 * np.pi * number / FINE**2)
        origin = np.column_stack([lens, np.zeros(ORACLE_RAYS)])[None]
        rays = pupil.focus_mm * chief[:, None] - origin
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        bundles.append((np.broadcast_to(origin, rays.shape), rays))
    origin, rays = (np.concatenate(parts, axis=1) for parts in zip(*bundles, strict=True))
    nearest = np.full(rays.shape[:2], np.inf)
    start, along = np.full(rays.shape, np.nan), np.full(rays.shape, np.nan)
    for mirror in layout.mirrors:
        entry, leaves, direction, _ = reflected(mirror, rays, None, origin)
        nearer = entry < nearest
        nearest[nearer] = entry[nearer]
        start[nearer], along[nearer] = leaves[nearer], direction[nearer]
    return Rays(start, along, np.isfinite(start[..., 0]))


def shown(rays: Rays, board: Checkerboard, rig_from_board: FloatArray) -> FloatArray:
    """Light (p,) of a board in the pixels of a strip: the mean over rays."""
    back = inverse(rig_from_board)
    start = rays.start @ back[:3, :3].T + back[:3, 3]
    along = rays.along @ back[:3, :3].T
    at = start - along * (start[..., 2:] / along[..., 2:])
    square = np.floor(np.where(rays.met[..., None], at, 0.0)[..., :2] / board.square_mm).astype(int)
    inside = (square >= 0).all(axis=-1) & (square < [board.cols, board.rows]).all(axis=-1)
    margin = (square >= -1).all(axis=-1) & (square <= [board.cols, board.rows]).all(axis=-1)
    # The first square is dark.
    dark = inside & (square.sum(axis=-1) % 2 == 0)
    seen = rays.met & margin & (along[..., 2] > 0.0)
    return np.asarray(np.where(seen, np.where(dark, INK, PAPER), 0.0).mean(axis=1))


def pictures(
    layout: Layout, sensor: SensorName, where: list[FloatArray], board: Checkerboard, places: list[Strip]
) -> dict[str, list[FloatArray]]:
    """Light (boards, h, w) of each strip, by renderer."""
    settings = RenderSettings(sensor=SENSORS[sensor], paper=PAPER, ink=INK, mirror_reflectance=1.0, maps=False)
    by_rays = [traced(layout, strip.crop, settings.sensor.pupil) for strip in places]
    fast = FastScene(layout.camera, layout.mirrors, board, settings)
    reference = BoardScene(layout.camera, layout.mirrors, board, settings)
    cut = settings.subpixels
    found: dict[str, list[list[FloatArray]]] = {name: [[] for _ in places] for name in ("oracle", "fast", "reference")}
    for pose in where:
        fast.place_board(pose)
        reference.place_board(pose)
        light = fast.render().astype(np.float64)
        for number, (strip, rays) in enumerate(zip(places, by_rays, strict=True)):
            x, y, width, height = strip.crop
            window = light[cut * y : cut * (y + height), cut * x : cut * (x + width)]
            found["fast"][number].append(window.reshape(height, cut, width, cut).mean(axis=(1, 3)))
            found["reference"][number].append(
                reference.render(spp=REFERENCE_SPP, seed=1, crop=strip.crop).astype(np.float64)
            )
            found["oracle"][number].append(shown(rays, board, pose).reshape(height, width))
    return {name: [np.array(each) for each in strips] for name, strips in found.items()}


def grouped_variance(strip: Strip, light: FloatArray) -> FloatArray:
    """Variance over boards (b, h, w), by `GROUP` pixels across the border."""
    across = strip.profile(light.var(axis=0))
    return np.asarray(across.reshape(-1, GROUP).mean(axis=1))


@dataclass(frozen=True)
class Compared:
    """Light of one strip, by renderer: (h, w) before the white board, (b, h, w) before checkerboards."""

    strip: Strip
    white: dict[str, FloatArray]
    checks: dict[str, FloatArray]

    def variances(self, renderer: str) -> FloatArray:
        """Variances over those of the oracle, by `GROUP` pixels; NaN in the dark."""
        expected, found = (grouped_variance(self.strip, self.checks[name]) for name in ("oracle", renderer))
        return np.asarray(found / np.where(expected > LEAST_VARIANCE, expected, np.nan))

    def told(self, sensor: str) -> None:
        """Print the figures."""
        for name in RENDERERS:
            edges = self.strip.profile(self.white[name] - self.white["oracle"])
            errors = self.strip.profile(self.checks[name] - self.checks["oracle"])
            ratio = self.variances(name)
            print(
                f"{sensor:6} {self.strip.name:7} {name:10} white: {100 * np.abs(edges).max():.2f} % at most; checks: "
                f"mean {100 * np.abs(errors.mean(axis=0)).max():.2f} % at most, "
                f"single {100 * np.sqrt(np.mean(errors**2)):.2f} % rms; "
                f"variance {np.nanmin(ratio):.3f} to {np.nanmax(ratio):.3f}"
            )


def compared(layout: Layout, sensor: SensorName) -> list[Compared]:
    """All strips with a sensor."""
    places, turn = strips(layout), layout.view_from_rig.T
    middle = np.array([2.5, 1.5, 0.0]) * WHITE.square_mm  # of a square that is paper
    ahead = rigid(turn, 400.0 * turn[:, 2] - turn @ middle)
    white = pictures(layout, sensor, [ahead], WHITE, places)
    checks = pictures(layout, sensor, poses(layout, BOARDS), BOARD, places)
    return [
        Compared(
            strip,
            {name: white[name][number][0] for name in white},
            {name: checks[name][number] for name in checks},
        )
        for number, strip in enumerate(places)
    ]


def figure(by_sensor: dict[SensorName, list[Compared]]) -> Figure:
    """Profiles and ratios of variances across one border, a column for each sensor."""
    drawn = Figure(figsize=(10.0, 7.5), layout="constrained")
    grid = drawn.subplots(3, len(by_sensor), sharex=True, sharey="row")
    for column, (sensor, strips) in enumerate(by_sensor.items()):
        shown = strips[0]
        at = np.arange(LONG_PX) - LONG_PX / 2.0 + 0.5
        for name, style in (("oracle", "k-"), ("reference", "C0--"), ("fast", "C1:")):
            grid[0, column].plot(at, shown.strip.profile(shown.white[name]), style, lw=2, label=name)
            grid[1, column].plot(at, shown.strip.profile(shown.checks[name][0]), style, lw=2, label=name)
        for name, style in (("reference", "C0.-"), ("fast", "C1.-")):
            grid[2, column].plot(at.reshape(-1, GROUP).mean(axis=1), shown.variances(name), style, label=name)
        grid[0, column].set_title(f"sensor {sensor}")
        grid[2, column].set(xlabel="px across the border", ylim=(0.9, 1.1))
    for row, label in enumerate(("light, white board", "light, checkerboard", "variance over boards / oracle")):
        grid[row, 0].set_ylabel(label)
    for axes in grid.ravel():
        axes.grid(alpha=0.3)
    grid[0, 0].legend()
    grid[2, 0].legend()
    return drawn


def main(picture: Path | None) -> None:
    layout = design(DesignSpec(fold_deg=90.0))
    found = {sensor: compared(layout, sensor) for sensor in SHOWN}
    for sensor, strips in found.items():
        for strip in strips:
            strip.told(sensor)
    if picture is not None:
        with atomic(picture) as temporary:
            figure(found).savefig(temporary, dpi=110, format="png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", type=Path, nargs="?", help="PNG file of the profiles")
    main(parser.parse_args().picture)
