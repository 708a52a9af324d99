"""Calibration from a video of a hand-held board: `python -m benchmarks.calibration_video CLIP [BOARD.toml]`.

Prints the calibration, and how well a calibration from the first two thirds predicts the last third: all corners of a
frame if the pose and bow of its board are fitted to all of its views, and its mirrored corners if these are fitted to
the direct view alone. For comparison, the floor: the same for corners simulated by the model.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.direct_prediction import predicted_mirrored, prediction_floor, refitted
from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.calibration.calibration_files import calibration_pictures
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.model_comparison import predict_held_out
from mirrorcam.optics.calibration.direct.direct_view import calibrate_with_direct_view
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.boards import Checkerboard, load_board

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
    """Format the root mean square of errors (n, 2), x / y, without rows of NaN."""
    finite = errors[np.isfinite(errors).all(axis=1)]
    return "{:.3f} / {:.3f} px".format(*np.sqrt(np.mean(finite**2, axis=0)))


def main(clip: Path, board: Checkerboard, json: Path | None) -> None:
    source = calibration_pictures([clip], 30, on_note=print)
    pictures = source.read()
    start_s = time.perf_counter()
    calibrate = partial(
        calibrate_with_direct_view, pictures, board, mirrors=MIRRORS, names=source.names, adjacent=source.adjacent
    )
    calibration = calibrate(max_pictures=source.max_pictures)
    assert calibration.diagnostics is not None
    print(f"calibrated in {time.perf_counter() - start_s:.1f} s: {calibration.notes[0]}")
    print(f"model {calibration.diagnostics.model_name}")
    for name in FIGURES:
        print(f"{name:32}{calibration.metrics[name].value:10.4f} {calibration.metrics[name].unit}")
    for name, metric in calibration.metrics.items():
        if name.startswith("split_"):
            print(f"{name:32}{metric.value:10.3f}")
    for alarm in calibration.diagnostics.alarms:
        print(f"alarm: {alarm}")

    full = calibrate()
    rows = full.observations.where(full.inliers)
    fitted = refitted(
        full, rows, Board.rigid(board.corners_in_board_mm), calibration.diagnostics.model_name.split("+")[1:]
    )
    frames = len(fitted.solution.estimate.rig_from_board)
    late = np.arange(frames) >= 2 * frames // 3
    print(f"\nlast third, {late.sum()} of {frames} frames, by a fit to the others, px")
    held = predict_held_out(fitted.solution.estimate, rows, fitted.model, late)
    fold = np.where(late, 0, 1)
    in_last_third = late[rows.frame]
    errors, _ = predicted_mirrored(fitted.solution.estimate, rows, fitted.model, fold)
    floor = prediction_floor(fitted, rows, fold)
    value = {name: metric.value for name, metric in calibration.metrics.items()}
    reprojection = f"{value['rms_x_px']:.3f} / {value['rms_y_px']:.3f} px"
    angle = f"{value['mirrors_0_1_angle_deg']:.2f} ± {value['mirrors_0_1_angle_sigma_deg']:.2f}°"
    table = Rows("", "x / y")
    table.add("reprojection", reprojection)
    table.add(
        "last third of the frames, by a fit to the others: pose and bow from all views",
        rms(held.residuals[held.inliers]),
    )
    table.add("mirrored corners of the last third, pose and bow from the direct view alone", rms(errors[in_last_third]))
    table.add("the same, simulated", rms(floor[np.tile(in_last_third, 3)]))
    table.add("angle between the mirrors", angle)
    figures = {"readout_of_interval": value["shutter_readout"], "near_far_ratio": value["split_near_ratio"]}
    write_record(json, "calibration_video", figures, table.table)


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
