"""Calibration of real photographs: `python -m benchmarks.calibration_photos FOLDER`.

The folder holds photographs of a checkerboard of 8 x 7 squares (1 unit of length each) and two mirrors that meet in a
corner. Prints how well nested models fit, and how well each photograph's direct view predicts its mirrored views with
planes, camera and board fitted to the other photographs; last, the same for corners simulated by the last model.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.direct_prediction import predicted_mirrored, prediction_floor, refitted
from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.nested_models import fit_with
from mirrorcam.optics.calibration.direct.direct_view import INTRINSICS, calibrate_with_direct_view
from mirrorcam.optics.calibration.direct.motion import camera_rotations, stabilised
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.boards import Checkerboard

TARGET = Checkerboard(cols=8, rows=7, square_mm=1.0)


def rms(errors: FloatArray) -> str:
    """Format the root mean square of errors (n, 2), x / y, without rows of NaN."""
    finite = errors[np.isfinite(errors).all(axis=1)]
    return "{:.3f} / {:.3f}".format(*np.sqrt(np.mean(finite**2, axis=0)))


def first_estimate_of(calibration: Calibration, board: Board, *, plate: bool) -> Estimate:
    estimate = Estimate.of(calibration.layout.camera, calibration.layout.mirrors, calibration.rig_from_board)
    if not plate:
        estimate = replace(estimate, thickness_mm=np.zeros(len(calibration.layout.mirrors)))
    return replace(estimate, shape=np.zeros(len(board.modes)))


def main(folder: Path, json: Path | None) -> None:
    photos = sorted(folder.glob("*.jpg"))
    pictures = [read_image(photo, grey=True) for photo in photos]
    calibration = calibrate_with_direct_view(pictures, TARGET, mirrors=2, names=[photo.name for photo in photos])
    steady, camera = calibration.observations, calibration.layout.camera
    rotations = camera_rotations(pictures, camera)
    if rotations is None:
        raise SystemExit("the background does not determine the camera's rotations")
    unsteady = stabilised(steady, camera, -rotations)
    corners = TARGET.corners_in_board_mm
    nominal, free = Board.rigid(corners), Board.free(corners)
    views = len(np.unique(np.stack([steady.frame, steady.view]), axis=1).T)
    print(f"{views} views with {len(steady)} corners found in {len(photos)} photographs")
    fold = np.arange(len(photos))
    rows = Rows("model", "all views", "mirrored corners of photographs left out")
    for label, observations, board, plate in (
        ("board as drawn, first-surface mirrors", unsteady, nominal, False),
        ("camera rotation between photographs compensated", steady, nominal, False),
        ("second-surface glass mirrors", steady, nominal, True),
        ("board corners estimated", steady, free, True),
    ):
        model = Model(INTRINSICS, thickness=plate, curvature=False, board=board)
        solution = fit(first_estimate_of(calibration, board, plate=plate), observations, model)
        errors, _ = predicted_mirrored(solution.estimate, observations, model, fold)
        rows.add(label, rms(solution.residuals), rms(errors))
    fitted = refitted(calibration, steady, nominal, ("board", "sheet"))
    for label, addition in (("camera turns in each photograph", "turn"), ("board bows in each photograph", "bow")):
        fitted = fit_with(addition, fitted, steady)
        solution = fitted.solution
        errors, _ = predicted_mirrored(solution.estimate, steady, fitted.model, fold)
        rows.add(label, rms(solution.residuals[solution.inliers]), rms(errors))
    rows.add("the last model, simulated", "", rms(prediction_floor(fitted, steady, fold)))
    finite = errors[np.isfinite(errors).all(axis=1)]
    figures = {
        "corners_found": len(steady),
        "corners": views * len(corners),
        "outliers": int((~solution.inliers).sum()),
        "predicted_px": float(np.sqrt(np.mean(finite**2))),
        "phone_turned_px": float(camera.fx_px * np.linalg.norm(rotations, axis=1).max()),
    }
    write_record(json, "calibration_photos", figures, rows.table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    add_json_option(parser)
    options = parser.parse_args()
    main(options.folder, options.json)
