"""Calibration of a mirror camera: frames through the mirrors, frames of the bare camera, and the nominal layout.

1. Corners, views and frames that contradict the others are taken out (`screening`).
2. The base camera from the frames without mirrors, and the boards by the nominal layout (`bootstrap`).
3. The mirrors, 3 numbers each, then everything jointly, then whatever more the data support (`diagnostics.ladder`).
4. How sure that is, and whether it can be right (`diagnostics`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from mirrorcam.optics.base.files import one_line
from mirrorcam.optics.base.values import FloatArray, InputError, Metric
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames
from mirrorcam.optics.calibration.detection.segmentation import Extremes, outlined
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, fit_metrics, uncertainty
from mirrorcam.optics.calibration.diagnostics.cross_validation import held_out
from mirrorcam.optics.calibration.diagnostics.diagnostics import diagnose
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection, select_model
from mirrorcam.optics.calibration.diagnostics.plausibility import check_solution
from mirrorcam.optics.calibration.diagnostics.screening import screen
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, UndeterminedError
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, points_at_camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.targets import Target

HOLD_OUT_EVERY = 5


def calibrate(
    frames: Iterable[Grey],
    base_frames: Iterable[Grey],
    layout: Layout,
    target: Target,
    *,
    level: str | None = None,
    detections: Path | None = None,
    workers: int = 1,
    on_frame: Callable[[int], None] = lambda done: None,
    on_seen: Callable[[Sequence[Observations]], None] = lambda seen: None,
) -> Calibration:
    """Calibrate a mirror camera from pictures of a board, through the mirrors and without them.

    Parameters
    ----------
    frames
        Pictures (h, w) in grey, uint8, of the board through the mirrors; each is read once, in turn.
    base_frames
        Pictures of the board by the same camera without mirrors. With none, the camera starts from that of `layout`.
    layout
        Nominal layout: where to look for the board, and where to start.
    target
        The board; its squares in mm set the scale.
    level
        Model to fit (`diagnostics.model_selection`); without it, the model is selected.
    detections
        Folder that keeps the corners found in each picture, so that none is searched twice.
    workers
        Number of processes that search for corners.
    on_frame
        Called with the number of pictures done.
    on_seen
        Called after each picture through the mirrors with all observations in these so far.

    Returns
    -------
    Calibration
        `layout` is the calibrated one, with covariance; with it poses of the boards (rig_from_board, mm), residuals in
        px, metrics and diagnostics.

    Raises
    ------
    InputError
        If the pictures do not determine camera and mirrors.
    """
    detect = partial(detect_frames, layout=layout, target=target, folder=detections, workers=workers)
    extremes = Extremes()

    def watched() -> Iterator[Grey]:
        for grey in frames:
            yield grey
            extremes.add(grey)  # once it is asked for the next one, this one has the size of the others

    def hear(found: Sequence[Observations]) -> None:
        on_frame(len(found))
        on_seen(found)

    seen = detect(watched(), mirrored=True, on_frame=hear)
    base = detect(base_frames, mirrored=False, on_frame=lambda found: on_frame(len(seen) + len(found)))
    return calibrate_corners(seen, base, layout, target.corners_in_board_mm, level=level, extremes=extremes)


def calibrate_corners(
    seen: list[Observations],
    base: list[Observations],
    layout: Layout,
    corners_in_board_mm: FloatArray,
    *,
    level: str | None = None,
    extremes: Extremes | None = None,
) -> Calibration:
    """The same from corners that were found already, a list entry per frame with and per frame without mirrors.

    Where the frames' `extremes` are given, the mirrors' outlines are those that the frames show.
    """
    notes = _notes(seen, base, layout)
    try:
        screened = screen(seen, base, layout, corners_in_board_mm)
    except UndeterminedError as error:
        raise InputError(f"the frames do not determine camera and mirrors: {error}") from None
    seen, base, notes = screened.seen, screened.base, notes + screened.notes
    used = [frame for frame, o in enumerate(seen) if len(o)]
    used_base = [frame for frame, o in enumerate(base) if len(o)]
    mirrored = Observations.join([seen[frame].shifted(place) for place, frame in enumerate(used)])
    direct = Observations.join([base[frame].shifted(len(used) + place) for place, frame in enumerate(used_base)])
    observations = Observations.join([mirrored, direct])

    try:
        camera = initial_estimates.base_camera(direct, layout.camera, corners_in_board_mm)
        start = initial_estimates.first_estimate(observations, camera, layout, corners_in_board_mm)
        reached = select_model(start, observations, corners_in_board_mm, level=level).widened_to(screened.widened)
        calibrated = _calibrated(reached, layout)
        if extremes is not None:
            calibrated, moved = outlined(calibrated, extremes)
            notes += moved
        diagnostics = diagnose(reached, observations, calibrated)
        reached = reached.widened_to(diagnostics.widened)
        solution = reached.solution
        notes += check_solution(solution, layout, mirrored_frames=len(used))
        metrics = fit_metrics(observations, solution)
        spatial = spatial_rms_mm(solution.estimate, observations, solution.inliers, reached.model.board)
        metrics["spatial_rms_mm"] = Metric(value=spatial, unit="mm")
        if len(used) > HOLD_OUT_EVERY:
            metrics |= _held_out(reached, observations, len(used))
        metrics |= diagnostics.metrics
        calibrated = calibrated.replaced(metrics=metrics, uncertainty=uncertainty(solution))
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
        diagnostics=diagnostics,
    )


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


def _held_out(reached: ModelSelection, observations: Observations, mirrored_frames: int) -> dict[str, Metric]:
    """How well a calibration without every fifth mirrored frame predicts those frames, their board poses aside."""
    out = np.zeros(len(reached.solution.estimate.rig_from_board), dtype=bool)
    out[HOLD_OUT_EVERY - 1 : mirrored_frames : HOLD_OUT_EVERY] = True
    left = held_out(reached.solution.estimate, observations, reached.model, out)
    spatial = spatial_rms_mm(left.estimate, left.observations, left.inliers, left.board)
    return {
        "held_out_rms_x_px": Metric(value=left.rms_px[0], unit="px"),
        "held_out_rms_y_px": Metric(value=left.rms_px[1], unit="px"),
        "held_out_outliers": Metric(value=int((~left.inliers).sum()), unit="1"),
        "held_out_spatial_rms_mm": Metric(value=spatial, unit="mm"),
    }


def spatial_rms_mm(estimate: Estimate, observations: Observations, inliers: BoolArray, board: Board) -> float:
    """The paper's spatial reprojection error: rms distance of each corner from the ray traced from its pixel.

    The mirrors keep distances, so it is taken where the base camera sees the corner, before reflection.
    """
    rows = observations.where(inliers)
    _, _, seen = points_at_camera(estimate, rows, board)
    rays = estimate.camera.unproject(rows.pixels)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return float(np.sqrt(np.mean(np.sum(np.cross(seen, rays) ** 2, axis=1))))


def _calibrated(reached: ModelSelection, layout: Layout) -> Layout:
    estimate = reached.solution.estimate
    mirrors = tuple(
        moved_to(mirror, centre).replaced(
            thickness_mm=thickness if mirror.is_second_surface else mirror.thickness_mm, curvature_per_m=curvature
        )
        for mirror, centre, thickness, curvature in zip(
            layout.mirrors,
            estimate.virtual_centres_in_rig_mm,
            estimate.thickness_mm.tolist(),
            estimate.curvature_per_m,
            strict=True,
        )
    )
    return layout.replaced(
        kind="calibrated",
        camera=estimate.camera,
        mirrors=mirrors,
        metrics={},
        verdict={},
        provenance={"nominal": layout.provenance.get("nominal", layout.identity), "level": reached.level},
        uncertainty=uncertainty(reached.solution),
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
