"""A board size in a wrong unit is reported, with the size that fits the mirrors."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.segmentation import DetectedEdge, Side
from mirrorcam.optics.calibration.diagnostics.board_scale import (
    ALARM_SIGMAS,
    NOTED_DEVIATION,
    common_scale,
    scale_doubt,
    size_ratio,
    wrong_size_message,
)
from mirrorcam.optics.calibration.diagnostics.calibration_result import tilted_to
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.perturbations import draw_as_built
from mirrorcam.optics.geometry.tolerances import Tolerances
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render

CAMERA = Camera(name="small", width_px=640, height_px=360, fx_px=453.0, fy_px=453.0, cx_px=319.5, cy_px=179.5)
LAYOUT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
BOARD = Checkerboard(cols=8, rows=5, square_mm=11.0)
DEVICES = 20
SEEN_MM = 0.15  # error of an edge


@pytest.fixture(scope="module")
def pictures() -> list[Grey]:
    turns = ([10.0, 12.0, 20.0], [-15.0, 20.0, 0.0])
    poses = [posed(BOARD, np.array([0.0, 300.0, 85.0]), np.array(turn), direct=False) for turn in turns]
    return [render(CAMERA, LAYOUT, BOARD, pose, noise_grey=3.0) for pose in poses]


@pytest.mark.parametrize("factor", [0.001, 1 / 25.4, 0.1, 1.0, 10.0])
def test_the_fitting_size_does_not_depend_on_the_stated_one(pictures: list[Grey], factor: float) -> None:
    ratio = size_ratio(pictures, LAYOUT, BOARD.replaced(square_mm=11.0 * factor))
    assert ratio is not None
    assert ratio * factor == pytest.approx(1.0, rel=0.06)


def test_another_unit_is_named(pictures: list[Grey]) -> None:
    for factor, unit in ((0.1, "cm"), (1 / 25.4, "inches")):
        board = BOARD.replaced(square_mm=11.0 * factor)
        said = wrong_size_message(pictures, LAYOUT, board)
        assert said == (
            f"board says squares of {11.0 * factor:g} mm, the pictures fit about 11 mm: were they measured in {unit}?"
        )
    with pytest.raises(InputError, match="were they measured in inches"):
        calibrate(pictures, [], LAYOUT, board)
    other = wrong_size_message(pictures, LAYOUT, BOARD.replaced(square_mm=30.0))
    assert other is not None
    assert "belong to a different device?" in other


def test_the_right_size_and_pictures_without_a_board_are_not_doubted(pictures: list[Grey]) -> None:
    assert wrong_size_message(pictures, LAYOUT, BOARD) is None
    upside_down = [np.ascontiguousarray(picture[::-1, ::-1]) for picture in pictures]
    assert wrong_size_message(upside_down, LAYOUT, BOARD) is None
    assert wrong_size_message([np.full((360, 640), 60, np.uint8)], LAYOUT, BOARD) is None


def middle_and_outward(mirror: Mirror, number: int) -> tuple[FloatArray, FloatArray]:
    frame, side = mirror.rig_from_plane, Side.of(mirror.outline_in_plane_mm, number)
    return frame[:3, 3] + frame[:3, :2] @ (side.start + side.length_mm / 2 * side.direction), frame[
        :3, :2
    ] @ side.outward


def edges_of(
    nominal: Layout, built: Layout, scale: float, random: np.random.Generator
) -> list[dict[int, DetectedEdge]]:
    """Return two thirds of a device's edges as frames show them if all estimated lengths are scaled by `scale`."""
    found = []
    for mirror, true in zip(nominal.mirrors, built.mirrors, strict=True):
        expected = tilted_to(mirror, scale * true.virtual_centre_in_rig_mm)
        edges = {}
        for number in range(len(mirror.outline_in_rig_mm)):
            middle, outward = middle_and_outward(expected, number)
            off = outward @ (scale * middle_and_outward(true, number)[0] - middle) + SEEN_MM * random.standard_normal()
            if random.random() < 0.67:
                edges[number] = DetectedEdge(np.zeros(3), np.zeros(2), float(off), middle, outward)
        found.append(edges)
    return found


def sigmas_off(layout: Layout, scale: float, *, tolerances: float, with_edges: bool) -> FloatArray:
    """Deviation of random devices' scales from 1, in standard deviations; 0 within the tolerance of the note."""
    off = []
    for seed in range(DEVICES):
        random = np.random.default_rng(seed)
        built = draw_as_built(layout, Tolerances.hobby().times(tolerances), random)
        edges = edges_of(layout, built, scale, random) if with_edges else []
        found = common_scale(layout, scale * built.virtual_centres_in_rig_mm, edges)
        off.append((found.factor - 1.0) / found.sigma if abs(found.factor - 1.0) > NOTED_DEVIATION else 0.0)
    return np.array(off)


@pytest.mark.parametrize("tolerances", [1.0, 2.0])
@pytest.mark.parametrize("with_edges", [True, False])
def test_no_device_is_taken_for_a_board_of_another_size(
    fold_90_layout: Layout, tolerances: float, with_edges: bool
) -> None:
    off = sigmas_off(fold_90_layout, 1.0, tolerances=tolerances, with_edges=with_edges)
    assert np.abs(off).max() < ALARM_SIGMAS


@pytest.mark.parametrize("scale", [0.95, 1.05])
def test_squares_five_percent_wrong_are_found_if_edges_are_seen(fold_90_layout: Layout, scale: float) -> None:
    off = sigmas_off(fold_90_layout, scale, tolerances=1.0, with_edges=True)
    assert (np.abs(off) > ALARM_SIGMAS).all()
    assert (np.sign(off) == np.sign(scale - 1.0)).all()
    assert (np.abs(sigmas_off(fold_90_layout, scale, tolerances=1.0, with_edges=False)) > ALARM_SIGMAS).mean() > 0.7


def test_a_badly_built_device_is_not_taken_for_a_wrong_square_size(fold_90_layout: Layout) -> None:
    for seed in range(20):
        random = np.random.default_rng(seed)
        centres = fold_90_layout.virtual_centres_in_rig_mm
        moved = centres + 4.0 * random.standard_normal(centres.shape)  # mirrors tilted by 1.4 deg and 2 mm off
        assert scale_doubt(fold_90_layout, moved, [], 12.0)[0] == ()


def test_a_mirror_cut_too_short_does_not_hide_the_scale(fold_90_layout: Layout) -> None:
    random = np.random.default_rng(0)
    built = draw_as_built(fold_90_layout, Tolerances.hobby(), random)
    edges = edges_of(fold_90_layout, built, 1.05, random)
    short = {
        number: DetectedEdge(e.line, e.offset_px, e.offset_mm - 3.0, e.midpoint_in_rig_mm, e.outward_in_rig)
        for number, e in edges[0].items()
    }
    found = common_scale(fold_90_layout, 1.05 * built.virtual_centres_in_rig_mm, [short, *edges[1:]])
    assert found.factor == pytest.approx(1.05, abs=0.01)
    assert found.factor - 1.0 > ALARM_SIGMAS * found.sigma


def test_the_scale_is_noted_then_an_alarm_then_refused(fold_90_layout: Layout) -> None:
    centres = fold_90_layout.virtual_centres_in_rig_mm
    assert scale_doubt(fold_90_layout, centres, [], 20.0) == ((), ())
    alarms, notes = scale_doubt(fold_90_layout, 1.025 * centres, [], 20.0)
    assert alarms == ()
    assert notes[0].startswith("the board's squares look like 19.5")
    alarms, notes = scale_doubt(fold_90_layout, 0.95 * centres, [], 20.0)
    assert notes == ()
    assert alarms[0].startswith("the board's squares look like 21.0")
    assert "board says square_mm = 20: all lengths come out 0.9" in alarms[0]
    with pytest.raises(InputError, match=r"squares look like 16\.\d+ ± \S+ mm, board says square_mm = 20"):
        scale_doubt(fold_90_layout, 1.2 * centres, [], 20.0)


def test_a_displaced_camera_does_not_change_the_scale(fold_90_layout: Layout) -> None:
    """A pupil moved by t moves every virtual centre by -2 (n.t) n, and the scale stays 1."""
    centres = fold_90_layout.virtual_centres_in_rig_mm
    normals = -centres / np.linalg.norm(centres, axis=1, keepdims=True)
    shift = np.array([0.4, -0.3, 0.5])
    found = common_scale(fold_90_layout, centres - 2.0 * (normals @ shift)[:, None] * normals)
    assert abs(found.factor - 1.0) < 2.0 * found.sigma
