"""Speed and corner noise of the renderers: `python -m benchmarks.render [--frames N] [--json F]`.

Times, in one run, a frame of the default camera (1920 x 1080, nine mirrors, a tilted ChArUco board) with the analytic
renderer and with the reference at several numbers of samples: the light alone, and the complete frame of a worker
(light, lens, noise, file). Then the same with a worker per core, and against the number of mirrors. The noise of
corners is the difference between OpenCV's cornerSubPix in a blurred, noiseless picture and in one of 1024 samples: it
includes neither the detector's error nor sensor noise.
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
from mirrorcam.optics.geometry.boards import Charuco, default_board
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.sets.frame_task import CaptureSetup, FrameTask, render_frame
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from mirrorcam.render_scenes.truth.corners import CornerProjector

LIMIT_S = 0.1
MIN_SPEEDUP = 10.0
SAMPLES = (4, 16, 64)
REFERENCE_SPP = 1024
BLUR_PX = 0.8
LENS = (0.05, -0.1, 0.0, 0.0, 0.0)
HALF_PX = 7
COUNTS = ((1, 2), (2, 2), (3, 3), (5, 5), (7, 7))

Picture = NDArray[np.float32]


def layout_of(rows: int, cols: int) -> Layout:
    """Return a design of rows and columns of mirrors, with a typical lens."""
    layout = design(DesignSpec(rows=rows, cols=cols))
    return layout.replaced(camera=layout.camera.replaced(distortion=LENS), metrics={}, verdict={})


def median_s(render_one: Callable[[int], object], frames: int) -> tuple[float, float]:
    """Return the seconds of the first frame, and the median of the others."""
    times = []
    for index in range(frames + 1):
        start_s = time.perf_counter()
        render_one(index)
        times.append(time.perf_counter() - start_s)
    return times[0], statistics.median(times[1:])


def tasks(layout: Layout, board: Charuco, poses: FloatArray, settings: RenderSettings) -> list[str]:
    """Return the tasks of the frames of a set without maps."""
    setup = CaptureSetup(built=layout, mirrors=True, board=board, settings=settings)
    return [
        FrameTask(
            setup=setup, name=f"{i:04d}{settings.suffix}", map_name=None, poses=pose[None], key=(0, i)
        ).model_dump_json()
        for i, pose in enumerate(poses)
    ]


def render_task(jobs: list[str], index: int) -> None:
    """Render one complete frame in this process."""
    render_frame(jobs[index])


def frame_with_workers_s(jobs: list[str]) -> float:
    """Return the seconds per frame with one worker per core, once every worker has started."""
    start_s, count = 0.0, 0
    # Every worker's first frame builds its scene and compiles: time begins when all have given one.
    for done, _ in enumerate(run_local(jobs, cores(), render_frame), start=1):
        if done == 2 * cores():
            start_s, count = time.perf_counter(), len(jobs) - done
    return (time.perf_counter() - start_s) / count


def corners(picture: Picture, start: FloatArray) -> FloatArray:
    """Return the corners (n, 2) that OpenCV detects in a blurred picture (h, w) of light."""
    first = np.ascontiguousarray(start[:, None], dtype=np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    refined = cv2.cornerSubPix(picture, first, (4, 4), (-1, -1), criteria)
    return np.asarray(refined[:, 0], dtype=np.float64)


def lens_blurred(radiance: Picture, subpixels: int) -> Picture:
    """Return the light (h, w) of pixels behind a lens with blur."""
    blurred = cv2.GaussianBlur(radiance, (0, 0), BLUR_PX * subpixels)
    size = (radiance.shape[1] // subpixels, radiance.shape[0] // subpixels)
    return np.asarray(cv2.resize(blurred, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def noise_px(
    scenes: dict[str, Callable[[], Picture]], layout: Layout, board: Charuco, pose: FloatArray
) -> dict[str, tuple[float, float]]:
    """Return the RMS along an axis and the maximum of the corners' displacements from those of the last scene."""
    px, visible = CornerProjector(layout, board).via_mirrors(pose)
    start = px[visible]
    detected = {name: corners(lens_blurred(render(), 2), start) for name, render in scenes.items()}
    *others, last = detected
    # Where a corner is so near an edge that the detector runs away from it in any picture, it says nothing of noise.
    used = np.linalg.norm(detected[last] - start, axis=1) < 0.3
    displacements = {name: (detected[name] - detected[last])[used] for name in others}
    return {
        name: (float(np.sqrt(np.mean(m**2))), float(np.linalg.norm(m, axis=1).max()))
        for name, m in displacements.items()
    }


def main(frames: int, json: Path | None) -> None:
    layout, board = layout_of(3, 3), default_board()
    poses = plan_frames(layout, board, 12, np.random.default_rng(0)).poses
    fast_settings = RenderSettings(renderer="fast", maps=False)
    start_s = time.perf_counter()
    fast = FastScene(layout.camera, layout.mirrors, board, fast_settings)
    print(f"fast: scene made in {time.perf_counter() - start_s:.1f} s")

    def light(index: int) -> None:
        fast.place_board(poses[index % len(poses)])
        fast.render()

    first, fast_s = median_s(light, 5 * frames)
    print(f"{'light one_process_s':34} first {first:6.3f} s  then {fast_s:6.3f} s a frame")
    costs = {"fast": fast_s}
    reference = BoardScene(layout.camera, layout.mirrors, board, RenderSettings())
    for spp in SAMPLES:

        def trace(index: int, spp: int = spp) -> None:
            reference.place_board(poses[index % len(poses)])
            reference.render(spp=spp // 4, seed=index, subpixels=2)

        first, costs[f"mitsuba {spp} spp"] = median_s(trace, frames)
        print(f"{f'mitsuba {spp} spp':34} first {first:6.3f} s  then {costs[f'mitsuba {spp} spp']:6.3f} s a frame")
    ratio = costs["mitsuba 16 spp"] / fast_s
    print(f"mitsuba at 16 spp / fast: {ratio:.1f} (limit >= {MIN_SPEEDUP:g})")

    figures: dict[str, float] = {}
    alone_s: dict[str, float] = {}
    for name, sensor in SENSORS.items():
        jobs = tasks(layout, board, np.tile(poses, (8, 1, 1)), fast_settings.replaced(sensor=sensor))
        alone_s[name] = one_process_s = median_s(partial(render_task, jobs), 2 * frames)[1]
        figures[f"frame_{name}_s"] = all_workers_s = frame_with_workers_s(jobs)
        workers_text = f"{all_workers_s:6.3f} s by {cores()} workers (limit {LIMIT_S:g})"
        print(f"complete frame, fast, {name:6} {one_process_s:6.3f} s in one process, {workers_text}")

    with_maps = [
        FrameTask.model_validate_json(task)
        for task in tasks(layout, board, poses, fast_settings.replaced(sensor=SENSORS["c920"], maps=True))
    ]
    jobs = [task.replaced(map_name=f"{task.name}.exr").model_dump_json() for task in with_maps]
    maps_s = median_s(partial(render_task, jobs), frames)[1] - alone_s["c920"]
    print(f"ground-truth maps, one process: {maps_s:6.3f} s more")

    for rows, cols in COUNTS:
        built = layout if (rows, cols) == (3, 3) else layout_of(rows, cols)
        board_poses = plan_frames(built, board, 4, np.random.default_rng(0)).poses
        scene = FastScene(built.camera, built.mirrors, board, fast_settings)

        def one(index: int, scene: FastScene = scene, board_poses: FloatArray = board_poses) -> None:
            scene.place_board(board_poses[index % len(board_poses)])
            scene.render()

        print(f"fast, {rows} x {cols} mirrors: {median_s(one, frames)[1]:6.3f} s a frame")

    fast.place_board(poses[0])
    reference.place_board(poses[0])
    scenes: dict[str, Callable[[], Picture]] = {"fast": fast.render}
    for spp in (*SAMPLES, REFERENCE_SPP):
        scenes[f"mitsuba {spp} spp"] = partial(reference.render, spp=spp // 4, seed=spp, subpixels=2)
    noise = noise_px(scenes, layout, board, poses[0])
    table_rows = Rows("", "light alone", "corner noise RMS, largest")
    names = {"fast": "fast"} | {f"mitsuba {spp} spp": f"{spp}" for spp in SAMPLES}
    names[f"mitsuba {SAMPLES[0]} spp"] = f"mitsuba, {SAMPLES[0]} samples per pixel"
    for renderer, (rms, largest) in noise.items():
        seconds = f"{costs[renderer]:.{2 if costs[renderer] < 1.0 else 1}f} s" + (
            " per frame" if renderer == "fast" else ""
        )
        times = f" ({ratio:.0f} times `fast`)" if renderer == "mitsuba 16 spp" else ""
        table_rows.add(names[renderer], seconds + times, f"{rms:.{3 if rms < 0.1 else 2}f}, {largest:.2f} px")
    write_record(json, "render", figures, table_rows.table)
    write_record(json, "render_maps", {"truth_maps_s": maps_s})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=5, help="number of frames of which each time is the median")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.frames, options.json)
