"""Calibration of a hand-held board before mirrors: `python -m benchmarks.calibration_video CLIP [BOARD.toml]`.

Prints how the video calibrates, and how a calibration from the first two thirds predicts the last third: the corners of
a frame where its board's pose and bow are fitted to all of its views, and its mirrored corners where they are fitted to
the direct view alone. Beside that stands the floor: the same of corners that the model simulates.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.direct_prediction import predicted_mirrored, prediction_floor, refitted
from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.calibration.calibration_files import calibration_pictures
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.model_comparison import predict_held_out
from mirrorcam.optics.calibration.direct.direct_view import calibrate_with_direct_view
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.targets import Checkerboard, load_board

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
    return "{:.3f} / {:.3f} px".format(*np.sqrt(np.mean(known**2, axis=0)))


def main(clip: Path, target: Checkerboard, json: Path | None) -> None:
    taken = calibration_pictures([clip], 30, on_note=print)
    pictures = taken.read()
    started = time.perf_counter()
    found = calibrate_with_direct_view(
        pictures, target, mirrors=MIRRORS, names=taken.names, max_pictures=taken.max_pictures, adjacent=taken.adjacent
    )
    assert found.diagnostics is not None
    print(f"calibrated in {time.perf_counter() - started:.1f} s: {found.notes[0]}")
    print(f"model {found.diagnostics.model_name}")
    for name in FIGURES:
        print(f"{name:32}{found.metrics[name].value:10.4f} {found.metrics[name].unit}")
    for name, metric in found.metrics.items():
        if name.startswith("split_"):
            print(f"{name:32}{metric.value:10.3f}")
    for alarm in found.diagnostics.alarms:
        print(f"alarm: {alarm}")

    every = calibrate_with_direct_view(pictures, target, mirrors=MIRRORS, names=taken.names, adjacent=taken.adjacent)
    rows = every.observations.where(every.inliers)
    fitted = refitted(every, rows, Board.rigid(target.corners_in_board_mm), found.diagnostics.model_name.split("+")[1:])
    frames = len(fitted.solution.estimate.rig_from_board)
    late = np.arange(frames) >= 2 * frames // 3
    print(f"\nlast third, {late.sum()} of {frames} frames, by a fit to the others, px")
    left = predict_held_out(fitted.solution.estimate, rows, fitted.model, late)
    fold = np.where(late, 0, 1)
    shown = late[rows.frame]
    errors, _ = predicted_mirrored(fitted.solution.estimate, rows, fitted.model, fold)
    floor = prediction_floor(fitted, rows, fold)
    value = {name: metric.value for name, metric in found.metrics.items()}
    counts = f"{value['corners']:.0f} corners, {value['outliers']:.0f} outliers"
    whole = f"{value['rms_x_px']:.3f} / {value['rms_y_px']:.3f} px"
    angle = f"{value['mirrors_0_1_angle_deg']:.2f} ± {value['mirrors_0_1_angle_sigma_deg']:.2f}°"
    rows_of = Rows("", "x / y")
    rows_of.add(f"reprojection, {counts}", whole)
    rows_of.add(
        "last third of the frames, by a fit to the others: pose and bow from all views",
        rms(left.residuals[left.inliers]),
    )
    rows_of.add("mirrored corners of the last third, pose and bow from the direct view alone", rms(errors[shown]))
    rows_of.add("the same, simulated", rms(floor[np.tile(shown, 3)]))
    rows_of.add("angle between the mirrors", angle)
    figures = {"readout_of_interval": value["shutter_readout"], "near_far_ratio": value["split_near_ratio"]}
    write_record(json, "calibration_video", figures, rows_of.table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", type=Path)
    parser.add_argument("board", type=Path, nargs="?", metavar="BOARD.toml")
    add_json_option(parser)
    options = parser.parse_args()
    board = load_board(options.board) if options.board else BOARD
    if not isinstance(board, Checkerboard):
        parser.error("expected a checkerboard")
    main(options.clip, board, options.json)
