"""Calibration with a direct view: of pictures whose truth is known, and of real photographs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.direct_prediction import on_first_mirror, predicted_mirrored, twice_reflected
from mirrorcam.optics.base.pictures import read_image
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.detection.checkerboard import Grey, confirm
from mirrorcam.optics.calibration.diagnostics.calibration_result import (
    Calibration,
    mirror_sigmas,
)
from mirrorcam.optics.calibration.direct.direct_view import INTRINSICS, calibrate_with_direct_view
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.targets import Charuco, Checkerboard
from mirrorcam.optics.geometry.transforms import rigid, transform
from tests.optics.synthetic import render

BOARD = Checkerboard(cols=8, rows=7, square_mm=20.0)
PHOTOGRAPHED = Checkerboard(cols=8, rows=7, square_mm=1.0)
CAMERA = Camera(
    width_px=1350,
    height_px=900,
    fx_px=1012.5,
    fy_px=1015.5,
    cx_px=663.0,
    cy_px=61.5,
    distortion=[-0.08, 0.05, 0, 0, 0],
)


def corner_of_two_mirrors(opening_deg: float) -> Layout:
    """Two upright mirrors that meet at z = 650 mm before the camera, the left half of the picture in one of them."""
    mirrors = []
    half = np.radians(opening_deg / 2)
    for side, low, high in ((-1, -0.65, -0.005), (1, 0.005, 0.65)):
        normal = np.array([-side * np.cos(half), 0.0, -np.sin(half)])
        plain = np.array([[low, -0.05], [high, -0.05], [high, 0.8], [low, 0.8]])
        rays = np.column_stack([plain, np.ones(4)])
        outline = rays * ((normal @ [0.0, 0.0, 650.0]) / (rays @ normal))[:, None]
        mirrors.append(Mirror.from_plane(np.array([0.0, 0.0, 650.0]), normal, outline_in_rig_mm=outline))
    return Layout(rows=1, cols=2, camera=CAMERA, mirrors=tuple(mirrors), view_from_rig=np.eye(3))


def picture_of(layout: Layout, pose: FloatArray, seed: int) -> Grey:
    """The mirrors' picture with the board itself in front of it."""
    through = render(CAMERA, layout, BOARD, pose, noise_grey=1.0, seed=seed)
    direct = render(CAMERA, None, BOARD, pose, noise_grey=1.0, seed=seed)
    size = np.array(BOARD.size_mm)
    outer = np.array([[0.0, 0, 0], [size[0], 0, 0], [*size, 0], [0, size[1], 0]])
    margin = 1.1 * (outer - outer.mean(axis=0)) + outer.mean(axis=0)
    polygon = CAMERA.project(transform(pose, margin))
    rows, cols = np.mgrid[: direct.shape[0], : direct.shape[1]]
    inside = np.ones(direct.shape, dtype=bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (rows - a[1]) - (b[1] - a[1]) * (cols - a[0]) > 0
    return np.where(inside, direct, through).astype(np.uint8)


# Middle of the board in mm; then its slope towards the camera, spin on that slope and lean, in degrees.
POSES = [
    ((10.0, 270.0, 450.0), (-84.0, 30.0, 0.0)),
    ((-15.0, 265.0, 440.0), (-78.0, -25.0, 6.0)),
    ((15.0, 280.0, 460.0), (-86.0, 75.0, -6.0)),
    ((0.0, 260.0, 440.0), (-75.0, 10.0, 4.0)),
    ((-10.0, 275.0, 450.0), (-90.0, 120.0, 0.0)),
]


def lying(centre: tuple[float, ...], turns_deg: tuple[float, ...]) -> FloatArray:
    """rig_from_board (4, 4) of a board that lies before the mirrors, its print towards camera and mirrors alike."""
    slope, spin, lean = turns_deg
    turn = Rotation.from_euler("XYZ", [slope, lean, spin], degrees=True).as_matrix()
    return rigid(turn, centre - turn @ BOARD.corners_in_board_mm.mean(axis=0))


@pytest.fixture(scope="module")
def calibrated() -> tuple[Layout, Calibration]:
    truth = corner_of_two_mirrors(90.0)
    pictures = [picture_of(truth, lying(*pose), seed) for seed, pose in enumerate(POSES)]
    pictures[0][375:600, 780:] = 60  # something stands before the right mirror
    names = [f"{number}.png" for number in range(len(pictures))]
    return truth, calibrate_with_direct_view(pictures, BOARD, mirrors=2, names=names)


def test_camera_and_planes_are_found_without_a_layout(calibrated: tuple[Layout, Calibration]) -> None:
    truth, found = calibrated
    assert set(found.observations.view.tolist()) == {DIRECT, 0, 1}
    for axis in "xy":
        assert found.metrics[f"rms_{axis}_px"].value < 0.1
    sigmas = mirror_sigmas(found.layout)
    for a, b, (tilt, distance) in zip(found.layout.mirrors, truth.mirrors, sigmas, strict=True):
        off = np.linalg.norm(np.cross(a.normal_in_rig, b.normal_in_rig))
        assert off < 4 * np.sqrt(2) * tilt < np.radians(0.3)
        assert abs(a.distance_mm - b.distance_mm) < 4 * distance < 0.005 * b.distance_mm
    angle = found.metrics["mirrors_0_1_angle_deg"].value
    sigma = found.metrics["mirrors_0_1_angle_sigma_deg"].value
    assert angle == pytest.approx(90.0, abs=max(0.05, 4 * sigma))
    assert sigma < 0.1


def test_a_view_that_is_not_found_is_named_and_the_rest_of_its_picture_used(
    calibrated: tuple[Layout, Calibration],
) -> None:
    _, found = calibrated
    assert "0.png: mirror 0-1 not found" in found.notes
    first = found.observations.where(found.observations.frame == 0)
    assert set(first.view.tolist()) == {DIRECT, 0}


def test_what_does_not_suffice_is_refused_in_one_line() -> None:
    blank = np.full((300, 400), 90, dtype=np.uint8)
    with pytest.raises(InputError, match="no 8 x 7 checkerboard found in any of 2 pictures"):
        calibrate_with_direct_view([blank, blank], BOARD, mirrors=2, names=["a", "b"])
    with pytest.raises(InputError, match="no pictures given"):
        calibrate_with_direct_view([], BOARD, mirrors=2, names=[])
    with pytest.raises(InputError, match="pictures of 2 sizes"):
        calibrate_with_direct_view([blank, blank[:200]], BOARD, mirrors=2, names=["a", "b"])
    with pytest.raises(InputError, match="plain checkerboard"):
        charuco = Charuco(cols=8, rows=7, square_mm=20.0, marker_mm=14.0)
        calibrate_with_direct_view([blank], charuco, mirrors=2, names=["a"])  # type: ignore[arg-type]  # the very thing that must fail
    bare = [render(CAMERA, None, BOARD, lying(*pose)) for pose in POSES[:3]]
    with pytest.raises(InputError, match="the pictures show 0 mirrors, expected 2"):
        calibrate_with_direct_view(bare, BOARD, mirrors=2, names=["a", "b", "c"])


@pytest.fixture(scope="module")
def photographed(two_mirror_photos: list[Path]) -> tuple[list[Grey], Calibration]:
    pictures = [read_image(photo, grey=True) for photo in two_mirror_photos]
    names = [photo.name for photo in two_mirror_photos]
    return pictures, calibrate_with_direct_view(pictures, PHOTOGRAPHED, mirrors=2, names=names)


def test_real_photographs_of_two_mirrors(photographed: tuple[list[Grey], Calibration]) -> None:
    """One phone camera and two planes behind glass explain every board, and stand square to each other."""
    _, found = photographed
    assert found.metrics["views"].value == 24
    assert len(found.observations) >= 1000
    assert found.inliers.mean() > 0.95
    for axis, every in zip("xy", np.sqrt(np.mean(found.residuals_px**2, axis=0)), strict=True):
        assert every <= 0.20, "all corners, those past the outlier rule included"
        assert found.metrics[f"flat_board_rms_{axis}_px"].value <= 0.30
    assert found.metrics["camera_turned_px"].value > 1.0
    assert found.metrics["sheet_mm"].value > 5.0 * found.metrics["sheet_sigma_mm"].value
    assert found.diagnostics is not None
    assert found.diagnostics.level == "joint+board+sheet"
    assert found.diagnostics.reference == DIRECT
    # What remains differs between photographs: it must be reported, and widen all error bounds.
    assert any("the halves differ" in alarm for alarm in found.diagnostics.alarms)
    assert found.diagnostics.widened > 2.0
    assert found.metrics["mirrors_0_1_angle_deg"].value == pytest.approx(90.0, abs=0.1)
    assert 0.0 < found.metrics["mirrors_0_1_angle_sigma_deg"].value < 0.05


def test_photographs_predict_each_other_from_the_direct_view_alone(
    photographed: tuple[list[Grey], Calibration],
) -> None:
    """What remains differs between photographs, above their direct views' noise; half are predicted to 0.3 px."""
    pictures, found = photographed
    board = Board.free(PHOTOGRAPHED.corners_in_board_mm)
    start = Estimate.of(found.layout.camera, found.layout.mirrors, found.rig_from_board)
    start = replace(start, shape=np.zeros(len(board.modes)))
    model = Model(INTRINSICS, thickness=True, curvature=False, board=board)
    rows = found.observations
    errors, unseen = predicted_mirrored(start, rows, model, np.arange(len(pictures)))
    mirrored = rows.view != DIRECT
    assert np.sqrt(np.mean(errors[mirrored] ** 2)) <= 0.55
    each = [np.sqrt(np.mean(errors[mirrored & (rows.frame == frame)] ** 2)) for frame in range(len(pictures))]
    assert np.median(each) <= 0.45

    off = []
    for frame, picture in enumerate(pictures):
        for path in ((0, 1), (1, 0)):
            shaped = Board.rigid(board.shaped(unseen[frame].shape))
            predicted = twice_reflected(replace(unseen[frame], shape=np.zeros(0)), shaped, 0, path)
            corners = confirm(picture, predicted, PHOTOGRAPHED)
            shown = on_first_mirror(unseen[frame], predicted[corners.ids], path)
            off.append((corners.pixels - predicted[corners.ids])[shown])
    together = np.concatenate(off)
    assert len(together) > 150
    assert np.sqrt(np.mean(together**2)) < 1.5, "the camera's turn of up to 1.5 px is not taken out here"
