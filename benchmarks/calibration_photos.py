"""Calibration of real photographs: `python -m benchmarks.calibration_photos FOLDER`.

The folder holds photographs of a checkerboard of 8 x 7 squares (1 unit of length each) and two mirrors that meet in a
corner. Prints how well nested models fit, how well each photograph's direct view predicts its mirrored views with
planes, camera and board fitted to the other photographs, and the prediction errors of corners seen in both mirrors
one after the other. The table separates errors of the model from those of the paper board and the phone: beside every
figure stands that of views with free poses, which no mirror model can improve on.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.direct_prediction import (
    on_first_mirror,
    predicted_mirrored,
    prediction_floor,
    refitted,
    twice_reflected,
)
from benchmarks.records import add_json_option, table, write_record
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import confirm
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.nested_models import fit_with
from mirrorcam.optics.calibration.direct.direct_view import INTRINSICS, calibrate_with_direct_view
from mirrorcam.optics.calibration.direct.motion import camera_rotations, stabilised
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.targets import Checkerboard

TARGET = Checkerboard(cols=8, rows=7, square_mm=1.0)
PATHS = ((0, 1), (1, 0))


def rms(errors: FloatArray) -> str:
    """Root mean square of (n, 2), x / y, without rows of NaN."""
    known = errors[np.isfinite(errors).all(axis=1)]
    return "{:6.3f} {:6.3f}".format(*np.sqrt(np.mean(known**2, axis=0))) if len(known) else "     -      -"


def cell(errors: FloatArray) -> str:
    """The same as a cell of the table."""
    return " / ".join(rms(errors).split())


def start_of(found: Calibration, board: Board, *, plate: bool) -> Estimate:
    estimate = Estimate.of(found.layout.camera, found.layout.mirrors, found.rig_from_board)
    if not plate:
        estimate = replace(estimate, thickness_mm=np.zeros(len(found.layout.mirrors)))
    return replace(estimate, shape=np.zeros(len(board.modes)))


def apart(observations: Observations) -> Observations:
    """Make each view of each frame a separate frame."""
    _, frame = np.unique(np.stack([observations.frame, observations.view]), axis=1, return_inverse=True)
    order = np.argsort(frame.ravel(), kind="stable")
    return Observations(
        frame.ravel()[order], observations.view[order], observations.corner[order], observations.pixels[order]
    )


SHOWN = {
    "as drawn, first-surface": "board as drawn, first-surface mirrors",
    "+ camera turned back": "camera rotation between photographs compensated",
    "+ second-surface": "second-surface glass mirrors",
    "+ corners of the board free": "board corners estimated",
    "+ camera turns in each photo": "camera turns in each photograph",
    "+ board bows in each photo": "board bows in each photograph",
}
"""Rows of the table by the labels that are printed."""


def main(folder: Path, json: Path | None) -> None:
    photos = sorted(folder.glob("*.jpg"))
    pictures = [read_image(photo, grey=True) for photo in photos]
    found = calibrate_with_direct_view(pictures, TARGET, mirrors=2, names=[photo.name for photo in photos])
    steady = found.observations
    camera = found.layout.camera
    turns = camera_rotations(pictures, camera)
    if turns is None:
        raise SystemExit("the background does not determine the camera's rotations")
    as_seen = stabilised(steady, camera, -turns)
    corners = TARGET.corners_in_board_mm
    drawn, free = Board.rigid(corners), Board.free(corners)
    views = len(np.unique(np.stack([steady.frame, steady.view]), axis=1).T)
    print(f"{views} views with {len(steady)} corners found in {len(photos)} photographs")
    print(
        "camera turned since the first, px at the centre: "
        + ", ".join(f"{v:.2f}" for v in turned_px(turns, camera.fx_px))
    )

    print("\nrms per axis, px (x y)           all            direct         mirror 0       mirror 1       predicted*")
    fold = np.arange(len(photos))
    table_rows: list[tuple[str, str, str]] = []
    for label, rows, board, plate in (
        ("as drawn, first-surface", as_seen, drawn, False),
        ("+ camera turned back", steady, drawn, False),
        ("+ second-surface", steady, drawn, True),
        ("+ corners of the board free", steady, free, True),
        ("free board, glass, as seen", as_seen, free, True),
    ):
        model = Model(INTRINSICS, thickness=plate, curvature=False, board=board)
        solution = fit(start_of(found, board, plate=plate), rows, model)
        errors, _ = predicted_mirrored(solution.estimate, rows, model, fold)
        parts = [solution.residuals] + [solution.residuals[rows.view == v] for v in (DIRECT, 0, 1)] + [errors]
        print(f"{label:32}" + "  ".join(rms(part) for part in parts))
        if label in SHOWN:
            table_rows.append((SHOWN[label], cell(solution.residuals), cell(errors)))
    shaped = Board.rigid(free.shaped(solution.estimate.shape))
    own, floor = refitted(found, steady, drawn, ("board", "sheet")), np.empty((0, 2))
    for label, addition in (("+ camera turns in each photo", "turn"), ("+ board bows in each photo", "bow")):
        own = fit_with(addition, own, steady)
        solution = own.solution
        errors, unseen = predicted_mirrored(solution.estimate, steady, own.model, fold)
        of_views = [solution.inliers & (steady.view == v) for v in (DIRECT, 0, 1)]
        parts = [solution.residuals[rows] for rows in (solution.inliers, *of_views)]
        print(f"{label:32}" + "  ".join(rms(part) for part in (*parts, errors)))
        table_rows.append((SHOWN[label], cell(parts[0]), cell(errors)))
        floor = prediction_floor(own, steady, fold)
    outliers = int((~solution.inliers).sum())
    print(f"{'the last, simulated':32}" + " " * 60 + rms(floor))
    table_rows.append(("the last model, simulated", "", cell(floor)))
    apart_cells = []
    solution = fit(
        start_of(found, free, plate=True), as_seen, Model(INTRINSICS, thickness=True, curvature=False, board=free)
    )
    for label, board in (("no mirror model, as drawn**", drawn), ("no mirror model, free board**", shaped)):
        rows = apart(as_seen)
        poses = np.repeat(found.rig_from_board, 3, axis=0) if len(np.unique(rows.frame)) == 3 * len(photos) else None
        if poses is None:
            continue
        start = start_of(found, drawn, plate=True).with_poses(poses)
        solution = fit(start, rows, Model(INTRINSICS, thickness=False, curvature=False, board=board, mirrors=False))
        parts = [solution.residuals] + [solution.residuals[rows.view == v] for v in (DIRECT, 0, 1)]
        print(f"{label:32}" + "  ".join(rms(part) for part in parts))
        apart_cells.append(cell(solution.residuals))
    table_rows.append(("an independent pose per view: board as drawn; estimated", "; ".join(apart_cells), ""))
    print("* mirrored corners of each photograph, from its direct view alone; the rest from the other photographs")
    print("** every view a pose of its own: what is left is paper, lens and finding")

    print(
        "\npredicted* by photograph, px       mirror 0       mirror 1       both mirrors one after the other (corners)"
    )
    twice = []
    for frame, photo in enumerate(photos):
        here = steady.frame == frame
        off = seen_twice(pictures[frame], unseen[frame], free, turns[frame])
        twice.append(off)
        cells = [rms(errors[here & (steady.view == v)]) for v in (0, 1)] + [rms(off)]
        print(f"{photo.name:32}" + "  ".join(cells) + f"  ({len(off)})")
    print(f"{'all':32}" + "  ".join(rms(errors[steady.view == v]) for v in (0, 1)) + f"  {rms(np.concatenate(twice))}")
    every = np.concatenate(twice)
    both_x_px, both_y_px = np.sqrt(np.mean(every**2, axis=0))
    known = errors[np.isfinite(errors).all(axis=1)]
    figures = {
        "corners_found": len(steady),
        "corners": views * len(corners),
        "outliers": outliers,
        "predicted_px": float(np.sqrt(np.mean(known**2))),
        "both_mirrors_x_px": float(both_x_px),
        "both_mirrors_y_px": float(both_y_px),
        "both_mirrors_corners": len(every),
        "phone_turned_px": float(turned_px(turns, camera.fx_px).max()),
    }
    columns = ("model", "all views", "mirrored corners of photographs left out")
    write_record(json, "calibration_photos", figures, table(columns, table_rows))


def turned_px(turns: FloatArray, focal_px: float) -> FloatArray:
    return np.asarray(focal_px * np.linalg.norm(turns, axis=1))


def seen_twice(picture: np.ndarray, estimate: Estimate, free: Board, turn: FloatArray) -> FloatArray:
    """Found minus predicted pixels (n, 2) of corners that one mirror shows in the other, where they can be seen."""
    board = Board.rigid(free.shaped(estimate.shape))
    estimate = replace(estimate, shape=np.zeros(0))
    errors = [np.empty((0, 2))]
    for path in PATHS:
        predicted = twice_reflected(estimate, board, 0, path)
        count = len(predicted)
        still = Observations.of_view(0, DIRECT, np.arange(count), predicted)
        in_picture = stabilised(still, estimate.camera, -turn[None]).pixels
        corners = confirm(picture, in_picture, TARGET)
        shown = on_first_mirror(estimate, predicted[corners.ids], path)
        errors.append((corners.pixels - in_picture[corners.ids])[shown])
    return np.concatenate(errors)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    add_json_option(parser)
    options = parser.parse_args()
    main(options.folder, options.json)
