"""Calibration of a hand-held board before mirrors: `python -m benchmarks.calibration_video CLIP [BOARD.toml]`.

Prints how the video calibrates, and how a calibration from the first two thirds predicts the last third: the corners of
a frame where its board's pose and bow are fitted to all of its views, and its mirrored corners where they are fitted to
the direct view alone. Beside that stands the floor: the same of corners that the model simulates.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.direct_prediction import predicted_mirrored, prediction_floor, refitted
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.cross_validation import held_out
from mirrorcam.optics.calibration.direct.direct_view import calibrate_with_direct_view
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.targets import Checkerboard, load_board
from mirrorcam.workflow.calibration_pictures import calibration_pictures

MIRRORS = 2
BOARD = Checkerboard(cols=8, rows=6, square_mm=25.0)
FIGURES = (
    "rms_x_px",
    "rms_y_px",
    "mirrors_0_1_angle_deg",
    "mirrors_0_1_angle_sigma_deg",
    "corners",
    "outliers",
    "shutter_readout",
)


def rms(errors: FloatArray) -> str:
    """Root mean square of (n, 2), x / y, without rows of NaN."""
    known = errors[np.isfinite(errors).all(axis=1)]
    return "{:6.3f} {:6.3f}".format(*np.sqrt(np.mean(known**2, axis=0)))


def main(clip: Path, target: Checkerboard) -> None:
    taken = calibration_pictures([clip], 30, on_video=print)
    pictures = taken.read()
    started = time.perf_counter()
    found = calibrate_with_direct_view(
        pictures, target, mirrors=MIRRORS, names=taken.names, most=taken.most, beside=taken.beside
    )
    assert found.diagnostics is not None
    print(f"calibrated in {time.perf_counter() - started:.1f} s: {found.notes[0]}")
    print(f"model {found.diagnostics.level}")
    for name in FIGURES:
        print(f"{name:32}{found.metrics[name].value:10.4f} {found.metrics[name].unit}")
    for name, metric in found.metrics.items():
        if name.startswith("split_"):
            print(f"{name:32}{metric.value:10.3f}")
    for alarm in found.diagnostics.alarms:
        print(f"alarm: {alarm}")

    every = calibrate_with_direct_view(pictures, target, mirrors=MIRRORS, names=taken.names, beside=taken.beside)
    rows = every.observations.where(every.inliers)
    fitted = refitted(every, rows, Board.rigid(target.corners_in_board_mm), found.diagnostics.level.split("+")[1:])
    frames = len(fitted.solution.estimate.rig_from_board)
    late = np.arange(frames) >= 2 * frames // 3
    print(f"\nlast third, {late.sum()} of {frames} frames, by a fit to the others, px          x      y")
    left = held_out(fitted.solution.estimate, rows, fitted.model, late)
    print(f"pose and bow from all views of the frame                         {rms(left.residuals[left.inliers])}")
    fold = np.where(late, 0, 1)
    shown = late[rows.frame]
    errors, _ = predicted_mirrored(fitted.solution.estimate, rows, fitted.model, fold)
    floor = prediction_floor(fitted, rows, fold)
    print(f"mirrored corners, pose and bow from the direct view alone        {rms(errors[shown])}")
    print(f"the same, simulated                                              {rms(floor[np.tile(shown, 3)])}")


if __name__ == "__main__":
    if len(sys.argv) not in {2, 3}:
        raise SystemExit(__doc__)
    board = load_board(Path(sys.argv[2])) if len(sys.argv) == 3 else BOARD
    if not isinstance(board, Checkerboard):
        raise SystemExit("expected a checkerboard")
    main(Path(sys.argv[1]), board)
