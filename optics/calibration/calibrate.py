"""Calibration of a mirror camera: frames through the mirrors, frames of the bare camera, and the nominal layout.

1. The base camera from the frames without mirrors.
2. The mirrors, 3 numbers each, from the nominal layout, with the camera held.
3. Everything jointly, frames with and without mirrors: what the paper left as future work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from optics.calibration import bootstrap
from optics.calibration.detection.corners import MIN_CORNERS, Corners, Grey
from optics.calibration.detection.detect import direct_view, sub_images
from optics.calibration.observations import DIRECT, Observations
from optics.calibration.result import Calibration, fit_metrics, uncertainty
from optics.calibration.solver.model import Model
from optics.calibration.solver.residuals import Board, Estimate, points_at_camera
from optics.calibration.solver.solve import BoolArray, Solution, UndeterminedError, fit, start_robustly
from optics.camera import INTRINSIC_NAMES, Camera
from optics.files import one_line
from optics.layout import Layout
from optics.mirror import Mirror
from optics.targets import Charuco, Checkerboard
from optics.values import FloatArray, InputError, Metric

MIN_CORNERS_PER_MIRROR = 20
HOLD_OUT_EVERY = 5


def calibrate(
    frames: Iterable[Grey],
    base_frames: Iterable[Grey],
    layout: Layout,
    target: Checkerboard | Charuco,
    *,
    on_frame: Callable[[int], None] | None = None,
) -> Calibration:
    """The calibrated layout from grey frames (h, w) with and without mirrors, taken one at a time.

    `layout` is the nominal one: it says where to look and where to start. Without base frames the camera starts from
    the nominal one too. Raises InputError where the frames do not suffice. `on_frame` hears how many frames are done.
    """
    if any(mirror.surface == "second" for mirror in layout.mirrors):
        raise InputError(
            "the layout has second-surface mirrors, expected first-surface ones: their slab is not modelled"
        )
    seen = _look(frames, lambda frame: sub_images(frame, layout, target), layout, on_frame, 0)
    base = _look(base_frames, lambda frame: direct_view(frame, target), layout, on_frame, len(seen))
    return calibrate_corners(seen, base, layout, target.corners_in_board_mm)


def calibrate_corners(
    seen: list[Observations], base: list[Observations], layout: Layout, corners_in_board_mm: FloatArray
) -> Calibration:
    """The same from corners that were found already, a list entry per frame with and per frame without mirrors."""
    notes = _notes(seen, base, layout)
    used = [frame for frame, o in enumerate(seen) if len(o)]
    used_base = [frame for frame, o in enumerate(base) if len(o)]
    mirrored = Observations.join([seen[frame].shifted(place) for place, frame in enumerate(used)])
    direct = Observations.join([base[frame].shifted(len(used) + place) for place, frame in enumerate(used_base)])
    observations = Observations.join([mirrored, direct])
    _check(mirrored, len(seen), layout)

    try:
        camera = _base_camera(direct, layout, corners_in_board_mm)
        start = _start(observations, camera, layout, corners_in_board_mm)
        solution = _two_stages(start, observations, len(used), corners_in_board_mm)
        metrics = fit_metrics(observations, solution)
        metrics["spatial_rms_mm"] = Metric(
            value=spatial_rms_mm(solution.estimate, observations, solution.inliers, corners_in_board_mm), unit="mm"
        )
        if len(used) > HOLD_OUT_EVERY:
            metrics |= _held_out(solution.estimate, observations, len(used), corners_in_board_mm)
        calibrated = _calibrated(solution, layout, metrics)
    except UndeterminedError as error:
        raise InputError(f"the frames do not determine camera and mirrors: {error}") from None
    except ValidationError as error:
        raise InputError(f"the frames lead to mirrors that cannot be: {one_line(error)}") from None
    return Calibration(
        layout=calibrated,
        rig_from_board=solution.estimate.rig_from_board,
        observations=observations,
        residuals_px=solution.residuals,
        inliers=solution.inliers,
        metrics=metrics,
        notes=notes,
    )


def _look(
    frames: Iterable[Grey],
    find: Callable[[Grey], Observations],
    layout: Layout,
    on_frame: Callable[[int], None] | None,
    done: int,
) -> list[Observations]:
    found = []
    expected = (layout.camera.height_px, layout.camera.width_px)
    for number, frame in enumerate(frames):
        if frame.shape != expected:
            height, width = frame.shape[:2]
            raise InputError(f"frame {number} is {width}x{height} px, the layout's camera {expected[1]}x{expected[0]}")
        found.append(find(frame))
        if on_frame is not None:
            on_frame(done + number + 1)
    return found


def _notes(seen: list[Observations], base: list[Observations], layout: Layout) -> tuple[str, ...]:
    notes = [f"frame {number}: no board found, not used" for number, o in enumerate(seen) if not len(o)]
    notes += [f"base frame {number}: no board found, not used" for number, o in enumerate(base) if not len(o)]
    for number, o in enumerate(seen):
        missing = sorted(set(range(len(layout.mirrors))) - set(o.view.tolist()))
        if len(o) and missing:
            notes.append(f"frame {number}: no board found in mirror {', '.join(map(str, missing))}")
    if not any(len(o) for o in base):
        notes.append("no frame without mirrors: the intrinsics rest on the mirrored views alone")
    return tuple(notes)


def _check(mirrored: Observations, frames: int, layout: Layout) -> None:
    if not len(mirrored):
        raise InputError(f"no corner of the board found in any of {frames} frames")
    counts = np.bincount(mirrored.view, minlength=len(layout.mirrors))
    worst = int(counts.argmin())
    if counts[worst] < MIN_CORNERS_PER_MIRROR:
        raise InputError(
            f"mirror {worst} shows {counts[worst]} corners in {frames} frames, expected {MIN_CORNERS_PER_MIRROR}"
        )


def _base_camera(direct: Observations, layout: Layout, corners_in_board_mm: FloatArray) -> Camera:
    """The camera from frames without mirrors, or the nominal one where there are none."""
    if not len(direct):
        return layout.camera
    views = [
        Corners(direct.corner[rows], direct.pixels[rows])
        for frame in np.unique(direct.frame)
        if (rows := direct.frame == frame).sum() >= MIN_CORNERS
    ]
    camera = bootstrap.intrinsics(
        views,
        corners_in_board_mm,
        width_px=layout.camera.width_px,
        height_px=layout.camera.height_px,
        full_distortion=True,
    )
    return camera.replaced(name=layout.camera.name)


def _start(observations: Observations, camera: Camera, layout: Layout, corners_in_board_mm: FloatArray) -> Estimate:
    """Nominal mirrors, and every board where the view that explains its frame best puts it."""
    poses = []
    for frame in range(int(observations.frame[-1]) + 1):
        rows = observations.where(observations.frame == frame)
        views = []
        for view in np.unique(rows.view):
            shown = rows.view == view
            mirror = None if view == DIRECT else layout.mirrors[view]
            views.append((mirror, Corners(rows.corner[shown], rows.pixels[shown])))
        poses.append(bootstrap.best_pose(camera, views, corners_in_board_mm))
    return Estimate.of(camera, layout.mirrors, np.array(poses))


def _two_stages(
    start: Estimate, observations: Observations, mirrored_frames: int, corners_in_board_mm: FloatArray
) -> Solution:
    """Mirrors and poses with the camera held, as in the paper, as the start of everything jointly."""
    board = Board.rigid(corners_in_board_mm)
    rows = observations.frame < mirrored_frames
    held = replace(start, rig_from_board=start.rig_from_board[:mirrored_frames])
    paper, _ = start_robustly(held, observations.where(rows), Model((), sheet=False, bend=False, board=board))
    poses = np.concatenate([paper.rig_from_board, start.rig_from_board[mirrored_frames:]])
    model = Model(INTRINSIC_NAMES, sheet=False, bend=False, board=board)
    return fit(replace(paper, rig_from_board=poses), observations, model)


def _held_out(
    estimate: Estimate, observations: Observations, mirrored_frames: int, corners_in_board_mm: FloatArray
) -> dict[str, Metric]:
    """How well a calibration without every fifth mirrored frame predicts those frames, their board poses aside."""
    board = Board.rigid(corners_in_board_mm)
    frames = len(estimate.rig_from_board)
    out = np.zeros(frames, dtype=bool)
    out[HOLD_OUT_EVERY - 1 : mirrored_frames : HOLD_OUT_EVERY] = True
    kept, kept_poses = _frames(observations, estimate, ~out)
    model = Model(INTRINSIC_NAMES, sheet=False, bend=False, board=board)
    fitted = fit(kept_poses, kept, model).estimate
    rest, rest_poses = _frames(observations, estimate, out)
    start = replace(fitted, rig_from_board=rest_poses.rig_from_board)
    solution = fit(start, rest, Model((), sheet=False, bend=False, board=board, mirrors=False))
    rms = solution.rms_px
    return {
        "held_out_rms_x_px": Metric(value=rms[0], unit="px"),
        "held_out_rms_y_px": Metric(value=rms[1], unit="px"),
        "held_out_outliers": Metric(value=int((~solution.inliers).sum()), unit="1"),
        "held_out_spatial_rms_mm": Metric(
            value=spatial_rms_mm(solution.estimate, rest, solution.inliers, corners_in_board_mm), unit="mm"
        ),
    }


def _frames(observations: Observations, estimate: Estimate, frames: BoolArray) -> tuple[Observations, Estimate]:
    """The rows and poses of some frames (f,), renumbered from 0."""
    number = np.cumsum(frames) - 1
    rows = observations.where(frames[observations.frame])
    renumbered = Observations(number[rows.frame], rows.view, rows.corner, rows.pixels)
    return renumbered, replace(estimate, rig_from_board=estimate.rig_from_board[frames])


def spatial_rms_mm(
    estimate: Estimate, observations: Observations, inliers: BoolArray, corners_in_board_mm: FloatArray
) -> float:
    """The paper's spatial reprojection error: rms distance of each corner from the ray traced from its pixel.

    The mirrors keep distances, so it is taken where the base camera sees the corner, before reflection.
    """
    rows = observations.where(inliers)
    _, _, seen = points_at_camera(estimate, rows, Board.rigid(corners_in_board_mm))
    rays = estimate.camera.unproject(rows.pixels)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return float(np.sqrt(np.mean(np.sum(np.cross(seen, rays) ** 2, axis=1))))


def _calibrated(solution: Solution, layout: Layout, metrics: dict[str, Metric]) -> Layout:
    mirrors = tuple(
        moved_to(mirror, centre)
        for mirror, centre in zip(layout.mirrors, solution.estimate.virtual_centres_in_rig_mm, strict=True)
    )
    return layout.replaced(
        kind="calibrated",
        camera=solution.estimate.camera,
        mirrors=mirrors,
        metrics=metrics,
        verdict={},
        provenance={"nominal": layout.identity},
        uncertainty=uncertainty(solution),
    )


def moved_to(mirror: Mirror, virtual_centre: FloatArray) -> Mirror:
    """The mirror as a rigid body, moved the shortest way (tilt, then shift along the normal) to a measured plane."""
    normal = -virtual_centre / np.linalg.norm(virtual_centre)
    axis = np.cross(mirror.normal_in_rig, normal)
    cosine = float(mirror.normal_in_rig @ normal)
    # Rodrigues' formula with sine and axis in one vector; the planes are never opposite.
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    distance = float(np.linalg.norm(virtual_centre)) / 2.0
    return mirror.moved(rotation, (-distance - normal @ middle) * normal)
