"""Speed and corner noise of the renderers: `python -m benchmarks.render [--frames N] [--json F]`.

Times, in one run, a frame of the default camera (1920 x 1080, nine mirrors, a tilted ChArUco board) by formula and by
the reference at several numbers of samples: the light alone, and the whole frame as a worker makes it (light, lens,
noise, file). Then the same by as many workers as there are cores, and by the number of mirrors. The noise of corners is
what OpenCV's cornerSubPix finds in a soft, noiseless picture, less what it finds in one of 1024 samples: no detector's
own error, and none of the sensor's noise.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.processes.worker_pool import cores, run_local
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco, default_board
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.sets.frame_task import CaptureSetup, FrameTask, render_frame
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from mirrorcam.render_scenes.truth.corners import Oracle

LIMIT_S = 0.1
TIMES_FASTER = 10.0
SAMPLES = (4, 16, 64)
REFERENCE_SPP = 1024
BLUR_PX = 0.8
LENS = (0.05, -0.1, 0.0, 0.0, 0.0)
HALF_PX = 7
COUNTS = ((1, 2), (2, 2), (3, 3), (5, 5), (7, 7))

Picture = NDArray[np.float32]


def camera_of(rows: int, cols: int) -> Layout:
    """The design of a count of mirrors, before the usual lens."""
    layout = design(DesignSpec(rows=rows, cols=cols))
    return layout.replaced(camera=layout.camera.replaced(distortion=LENS), metrics={}, verdict={})


def median_s(take: Callable[[int], object], frames: int) -> tuple[float, float]:
    """Seconds of the first frame, and the median of those after it."""
    times = []
    for index in range(frames + 1):
        started = time.perf_counter()
        take(index)
        times.append(time.perf_counter() - started)
    return times[0], statistics.median(times[1:])


def tasks(layout: Layout, board: Charuco, poses: FloatArray, settings: RenderSettings) -> list[str]:
    """The frames of a set without maps, as workers get them."""
    setup = CaptureSetup(built=layout, mirrors=True, target=board, settings=settings)
    return [
        FrameTask(
            setup=setup, name=f"{i:04d}{settings.suffix}", map_name=None, poses=pose[None], key=(0, i)
        ).model_dump_json()
        for i, pose in enumerate(poses)
    ]


def rendered(asked: list[str], index: int) -> None:
    """One whole frame, in this process."""
    render_frame(asked[index])


def whole_frames_s(asked: list[str]) -> float:
    """Seconds a frame by one worker for each core, from the answer of the first to that of the last."""
    started, count = 0.0, 0
    # Every worker's first frame builds its scene and compiles: time begins when all have given one.
    for done, _ in enumerate(run_local(asked, cores(), render_frame), start=1):
        if done == 2 * cores():
            started, count = time.perf_counter(), len(asked) - done
    return (time.perf_counter() - started) / count


def corners(picture: Picture, start: FloatArray) -> FloatArray:
    """Corners (n, 2) that OpenCV finds in a picture (h, w) of light, blurred by the lens."""
    first = np.ascontiguousarray(start[:, None], dtype=np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    found = cv2.cornerSubPix(picture, first, (4, 4), (-1, -1), criteria)
    return np.asarray(found[:, 0], dtype=np.float64)


def soft(radiance: Picture, cut: int) -> Picture:
    """Light (h, w) of pixels behind a lens that blurs."""
    blurred = cv2.GaussianBlur(radiance, (0, 0), BLUR_PX * cut)
    size = (radiance.shape[1] // cut, radiance.shape[0] // cut)
    return np.asarray(cv2.resize(blurred, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def noise_px(
    scenes: dict[str, Callable[[], Picture]], layout: Layout, board: Charuco, pose: FloatArray
) -> dict[str, tuple[float, float]]:
    """RMS along an axis, and the largest, of what corners move by against those of the last scene."""
    px, visible = Oracle(layout, board).via_mirrors(pose)
    start = px[visible]
    found = {name: corners(soft(render(), 2), start) for name, render in scenes.items()}
    *others, last = found
    # Where a corner is so near an edge that the detector runs away from it in any picture, it says nothing of noise.
    kept = np.linalg.norm(found[last] - start, axis=1) < 0.3
    moved = {name: (found[name] - found[last])[kept] for name in others}
    return {name: (float(np.sqrt(np.mean(m**2))), float(np.linalg.norm(m, axis=1).max())) for name, m in moved.items()}


def main(frames: int, json: Path | None) -> None:
    layout, board = camera_of(3, 3), default_board()
    poses = plan_frames(layout, board, 12, np.random.default_rng(0)).poses
    by_formula = RenderSettings(renderer="fast", maps=False)
    started = time.perf_counter()
    fast = FastScene(layout.camera, layout.mirrors, board, by_formula)
    print(f"fast: scene made in {time.perf_counter() - started:.1f} s")

    def light(index: int) -> None:
        fast.place_board(poses[index % len(poses)])
        fast.render()

    first, fast_s = median_s(light, 5 * frames)
    print(f"{'light alone':34} first {first:6.3f} s  then {fast_s:6.3f} s a frame")
    costs = {"fast": fast_s}
    reference = BoardScene(layout.camera, layout.mirrors, board, RenderSettings())
    for spp in SAMPLES:

        def traced(index: int, spp: int = spp) -> None:
            reference.place_board(poses[index % len(poses)])
            reference.render(spp=spp // 4, seed=index, subpixels=2)

        first, costs[f"mitsuba {spp} spp"] = median_s(traced, frames)
        print(f"{f'mitsuba {spp} spp':34} first {first:6.3f} s  then {costs[f'mitsuba {spp} spp']:6.3f} s a frame")
    ratio = costs["mitsuba 16 spp"] / fast_s
    print(f"mitsuba at 16 spp / fast: {ratio:.1f} (limit >= {TIMES_FASTER:g})")

    figures: dict[str, float] = {}
    alone_s: dict[str, float] = {}
    for name, sensor in SENSORS.items():
        asked = tasks(layout, board, np.tile(poses, (8, 1, 1)), by_formula.replaced(sensor=sensor))
        alone_s[name] = alone = median_s(partial(rendered, asked), 2 * frames)[1]
        figures[f"frame_{name}_s"] = together = whole_frames_s(asked)
        by_all = f"{together:6.3f} s by {cores()} workers (limit {LIMIT_S:g})"
        print(f"whole frame, fast, {name:6} {alone:6.3f} s in one process, {by_all}")

    with_maps = [
        FrameTask.model_validate_json(each)
        for each in tasks(layout, board, poses, by_formula.replaced(sensor=SENSORS["c920"], maps=True))
    ]
    asked = [each.replaced(map_name=f"{each.name}.exr").model_dump_json() for each in with_maps]
    maps_s = median_s(partial(rendered, asked), frames)[1] - alone_s["c920"]
    print(f"maps of the truth, one process: {maps_s:6.3f} s more")

    for rows, cols in COUNTS:
        built = layout if (rows, cols) == (3, 3) else camera_of(rows, cols)
        where = plan_frames(built, board, 4, np.random.default_rng(0)).poses
        scene = FastScene(built.camera, built.mirrors, board, by_formula)

        def one(index: int, scene: FastScene = scene, where: FloatArray = where) -> None:
            scene.place_board(where[index % len(where)])
            scene.render()

        print(f"fast, {rows} x {cols} mirrors: {median_s(one, frames)[1]:6.3f} s a frame")

    fast.place_board(poses[0])
    reference.place_board(poses[0])
    scenes: dict[str, Callable[[], Picture]] = {"fast": fast.render}
    for spp in (*SAMPLES, REFERENCE_SPP):
        scenes[f"mitsuba {spp} spp"] = partial(reference.render, spp=spp // 4, seed=spp, subpixels=2)
    noise = noise_px(scenes, layout, board, poses[0])
    lines = Rows("", "light alone", "corner noise RMS, largest")
    names = {"fast": "fast"} | {f"mitsuba {spp} spp": f"{spp}" for spp in SAMPLES}
    names[f"mitsuba {SAMPLES[0]} spp"] = f"mitsuba, {SAMPLES[0]} samples per pixel"
    for by, (rms, most) in noise.items():
        seconds = f"{costs[by]:.{2 if costs[by] < 1.0 else 1}f} s" + (" per frame" if by == "fast" else "")
        times = f" ({ratio:.0f} times `fast`)" if by == "mitsuba 16 spp" else ""
        lines.add(names[by], seconds + times, f"{rms:.{3 if rms < 0.1 else 2}f}, {most:.2f} px")
    write_record(json, "render", figures, lines.table)
    write_record(json, "render_maps", {"truth_maps_s": maps_s})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=5, help="frames that each time is the median of")
    add_json_option(parser)
    given = parser.parse_args()
    main(given.frames, given.json)
