"""How well edges and scenes tell the tilts of mirrors: `python -m benchmarks.alignment [CASE ...] [--json FILE]`.

Devices of the default layout with errors of building drawn at random: tilts of 0.5 deg, shifts, cuts, the camera's seat
and its lens (`BuildErrors`). Cases: `sheet`, one frame of a white sheet; `still` and `moving`, one and ten frames of a
checkerboard of 11 mm at random poses, the hardest texture there is; all three as the fast renderer sees them with the
lens of a C920, its blur at the edges included, and noise of 1.5 grey levels; `scene`, three frames of textured sheets
by a pinhole, of a device built half as badly.

Prints for each case the error and the stated standard deviation (RMS) of tilts about both axes, the error of what tilts
differ from the mean of all mirrors (a turn of all looks like one of the camera), the squared error over
the stated variance (1 is right), how many tilts are told at all, how far edges are seen from where they are, and the
time that a frame takes; and the Cramer-Rao bound of edges that are known to .05 and .1 px.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.records import SIGMA, add_json_option, table, write_record
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.alignment.alignment import Alignment, EdgeAligner, SceneAligner
from mirrorcam.optics.alignment.build_errors import BuildErrors, BuiltDevice, EdgePoints
from mirrorcam.optics.alignment.edge_profiles import stations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Checkerboard
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from tests.optics.alignment.built_devices import built, tilts_deg
from tests.optics.drift.textured_scenes import Shot, fractal, photograph, scene

LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
NOISE, STRAY = 1.5, 3.0
CASES = {"sheet": 1, "still": 1, "moving": 10, "scene": 3}
"""Frames of each case."""
SAID = {
    "sheet": "one of a white sheet",
    "still": "one of a checkerboard of 11 mm",
    "moving": "ten of a checkerboard that moves",
    "scene": "three of textured sheets, by points",
}
HEAD = (
    "frames",
    "error, right / down",
    f"stated {SIGMA}",
    "squared error over variance",
    "told",
)
SMALLER = 0.5
EDGES_PX = (0.05, 0.1)
DRAWS = 50


def drawn(layout: Layout, errors: BuildErrors, seed: int, scale: float = 1.0) -> tuple[Layout, FloatArray]:
    """A device at random, and its errors (p,) in standard deviations."""
    random = np.random.default_rng(seed)
    for _ in range(DRAWS):
        units = scale * random.standard_normal(BuiltDevice(layout, errors).count)
        try:
            return built(layout, errors, units), units
        except InputError:
            continue
    raise InputError("no device can be drawn")


def rendered(layout: Layout, square_mm: float, frames: int, random: Any) -> list[NDArray[np.uint8]]:
    """Frames (h, w) of a checkerboard that fills all views; of squares larger than that, of a white one."""
    cols, rows = max(int(900 / square_mm) // 2 * 2 + 1, 3), max(int(700 / square_mm) // 2 * 2, 4)
    board = Checkerboard(cols=cols, rows=rows, square_mm=square_mm)
    settings = RenderSettings(sensor=SENSORS["c920"], maps=False)
    shown = FastScene(layout.camera, layout.mirrors, board, settings)
    found = []
    for _ in range(frames):
        depth, angles = random.uniform(300.0, 500.0), random.uniform(-0.4, 0.4, 3)
        turn = layout.view_from_rig.T @ Rotation.from_euler("xyz", angles).as_matrix()
        middle = np.array([2.5, 1.5, 0.0]) if square_mm > 500.0 else np.array([cols, rows, 0.0]) / 2.0
        pose = np.eye(4)
        slide = np.array([*random.uniform(-20.0, 20.0, 2), 0.0])
        pose[:3, :3], pose[:3, 3] = turn, depth * layout.view_from_rig[2] - turn @ (middle * square_mm + slide)
        shown.place_board(pose)
        size, fine = (layout.camera.height_px, layout.camera.width_px), settings.subpixels
        light = shown.render().reshape(size[0], fine, size[1], fine).mean(axis=(1, 3)) * 255.0 + STRAY
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), 0.8)) + random.normal(0.0, NOISE, size)
        found.append(np.clip(light, 0.0, 255.0).round().astype(np.uint8))
    return found


def bound_deg(layout: Layout, errors: BuildErrors, edge_px: float) -> FloatArray:
    """The Cramer-Rao bound (mirrors, 2) of tilts to the right and down, of edges known to a standard deviation."""
    device = BuiltDevice(layout, errors)
    seen = stations(device)
    information = np.eye(device.count)
    for points, kept in ((seen.own, np.ones(len(seen.place), bool)), (seen.other, seen.paired)):
        _, jacobian = device.pixels_with_jacobian(points, np.zeros(device.count))
        by = np.einsum("ni,nip->np", seen.out, jacobian)[kept]
        count = _of_edge(points, kept)
        information += (by / count[:, None]).T @ by / edge_px**2
    sigma = np.sqrt(np.diag(np.linalg.inv(information))) * device.sigma
    return np.degrees([[sigma[device.tilts(k)][1], sigma[device.tilts(k)][0]] for k in range(len(layout.mirrors))])


def _of_edge(points: EdgePoints, kept: NDArray[np.bool_]) -> FloatArray:
    """Number (n,) of stations on each point's edge: together they have one error."""
    label = (points.mirror * 100 + points.edge)[kept]
    return np.array([float((label == each).sum()) for each in label])


def edge_errors_px(truth: Layout, found: Alignment) -> FloatArray:
    """Errors (n,) of where edges are seen."""
    assert found.edges is not None
    seen, errors = found.edges.seen, []
    for place, (points, apart) in enumerate(((seen.own, 0.0), (seen.other, seen.apart_px))):
        at = []
        for mirror, edge, part in zip(points.mirror, points.edge, points.part, strict=True):
            corners = truth.mirrors[mirror].apparent.outline_in_rig_mm
            at.append(corners[edge] + part * (corners[(edge + 1) % len(corners)] - corners[edge]))
        offset = ((truth.camera.project(np.array(at)) - seen.place) * seen.out).sum(axis=1) - apart
        kept = seen.paired if place else np.ones(len(offset), bool)
        errors.append((found.edges.offset_px[:, place] - offset)[kept])
    joined = np.concatenate(errors)
    return joined[np.isfinite(joined)]


@dataclass(frozen=True)
class Found:
    """A row of the table, the least and largest error about an axis, and what tilts differ from the mean of all."""

    row: tuple[str, ...]
    axes_deg: tuple[float, float]
    against_mean_deg: float


def case(name: str, layout: Layout, devices: int, first: int) -> Found:
    """Print the figures of a case, and return them."""
    smaller = SMALLER if name == "scene" else 1.0
    errors = BuildErrors()
    aligner: Any = SceneAligner(layout, errors) if name == "scene" else EdgeAligner(layout, errors)
    error, sigma, told, away, seconds = [], [], [], [], []
    for seed in range(first, first + devices):
        truth, units = drawn(layout, errors, seed, smaller)
        random = np.random.default_rng(1000 + seed)
        if name == "scene":
            textures = [fractal(random, slope=slope) for slope in (0.8, 1.2, 1.6)]
            frames = [
                photograph(truth, scene(random, (300.0, 600.0), textures, layout.camera.fx_px), Shot(), random)
                for _ in range(CASES[name])
            ]
        else:
            frames = rendered(truth, 2000.0 if name == "sheet" else 11.0, CASES[name], random)
        start = time.perf_counter()
        found = aligner.align(frames)
        seconds.append(time.perf_counter() - start)
        given = np.array([each.estimate_deg for each in found.mirrors])
        error.append(given - tilts_deg(layout, errors, units))
        sigma.append([each.sigma_deg for each in found.mirrors])
        told.append([[np.isfinite(each.right_deg), np.isfinite(each.down_deg)] for each in found.mirrors])
        if found.edges is not None:
            away.append(edge_errors_px(truth, found))
    every, stated = np.array(error), np.array(sigma)
    kept = np.isfinite(every)
    off = np.abs(np.concatenate(away)) if away else np.zeros(0)
    edges = f"; edges off {np.median(off):.2f} px, 9 in 10 {np.quantile(off, 0.9):.2f}" if away else ""
    right, down = (np.sqrt(np.nanmean(every[..., axis] ** 2)) for axis in (0, 1))
    apart = every - np.nanmean(every, axis=1, keepdims=True)
    together = np.sqrt(np.nanmean(apart**2))
    stated_rms = np.sqrt(np.mean(stated**2, axis=(0, 1)))
    print(
        f"{name:7} {devices} devices, {CASES[name]} frames: error right {right:.3f} down {down:.3f} deg, against the "
        f"mean of all mirrors {together:.3f}; stated {stated_rms[0]:.3f} {stated_rms[1]:.3f}; squared error over "
        f"variance {np.mean((every[kept] / stated[kept]) ** 2):.2f}; told {100 * np.mean(told):.0f} %{edges}; "
        f"{np.median(seconds):.1f} s"
    )
    ratio = np.mean((every[kept] / stated[kept]) ** 2)
    sigmas = " / ".join(f"{each:.2f}°" for each in stated_rms)
    share = f"{100 * np.mean(told):.0f} %"
    row = (SAID[name], f"{right:.2f}° / {down:.2f}°", sigmas, f"{ratio:.2f}", share)
    return Found(row, (float(min(right, down)), float(max(right, down))), float(together))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=[], metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--devices", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    parser.add_argument("--layout", type=Path, default=LAYOUT)
    add_json_option(parser)
    given = parser.parse_args()
    layout = Layout.load(given.layout)
    limits: dict[float, FloatArray] = {}
    for edge_px in EDGES_PX:
        limits[edge_px] = bound = bound_deg(layout, BuildErrors(), edge_px)
        print(
            f"bound of edges known to {edge_px} px: right {bound[:, 0].min():.2f} to {bound[:, 0].max():.2f}, "
            f"down {bound[:, 1].min():.2f} to {bound[:, 1].max():.2f} deg; before: {BuildErrors().tilt_deg} deg"
        )
    found = {name: case(name, layout, given.devices, given.first) for name in given.cases or CASES}
    write_record(given.json, "alignment", table=table(HEAD, [each.row for each in found.values()]))
    sharpest = np.median(limits[EDGES_PX[0]], axis=0)
    figures = {"edge_lifted_mm": 10.0 * float(np.tan(np.radians(0.4)))}
    figures |= {"bound_least_deg": float(sharpest.min()), "bound_most_deg": float(sharpest.max())}
    if "scene" in found:
        least, most = found["scene"].axes_deg
        figures |= {"points_least_deg": least, "points_most_deg": most}
        figures |= {"points_against_mean_deg": found["scene"].against_mean_deg}
    write_record(given.json, "alignment_bounds", figures)


if __name__ == "__main__":
    main()
