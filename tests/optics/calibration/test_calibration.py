"""Calibration from pictures to a layout, against the layout that made the pictures."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration import calibration
from mirrorcam.optics.calibration.calibration import PictureReader, calibrate
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_frames, detect_sub_images
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, mirror_sigmas
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render

# The renderer's error of a thousandth of a pixel would be visible with less noise.
NOISE_GREY = 8.0
BOARD = Charuco(cols=16, rows=11, square_mm=14.0, marker_mm=8.75)
PLAIN = Checkerboard(cols=9, rows=6, square_mm=9.0)
CAMERA = Camera(name="small", width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
TURNS_DEG = [
    (20.0, 15.0, 5.0),
    (-22.0, 10.0, -8.0),
    (5.0, -28.0, 12.0),
    (-8.0, 25.0, 0.0),
    (25.0, -18.0, -15.0),
    (-25.0, -20.0, 7.0),
    (0.0, 5.0, 25.0),
]
TINY_CAMERA = Camera(width_px=64, height_px=48, fx_px=60.0, fy_px=60.0, cx_px=31.5, cy_px=23.5)
TINY_BOARD = Checkerboard(cols=5, rows=4, square_mm=10.0)


def mirrored_pose(number: int) -> FloatArray:
    return posed(BOARD, np.array([0.0, 280.0 + 10 * number, 85.0]), np.array(TURNS_DEG[number]), direct=False)


@dataclass(frozen=True)
class Set:
    nominal: Layout
    truth: Layout
    frames: list[Grey]
    base: list[Grey]


def draw(nominal: Layout, seed: int) -> Layout:
    """An as-built layout: mirrors tilted by 0.3 deg and shifted by 0.3 mm, another lens."""
    random = np.random.default_rng(seed)
    mirrors = tuple(
        mirror.moved(
            Rotation.from_rotvec(np.radians(0.3) * random.normal(size=3)).as_matrix(),
            0.3 * random.normal() * mirror.normal_in_rig,
        )
        for mirror in nominal.mirrors
    )
    camera = nominal.camera.replaced(
        fx_px=684.0, fy_px=685.0, cx_px=476.0, cy_px=272.0, distortion=[0.04, -0.09, 4e-4, -3e-4, 0.0]
    )
    return nominal.replaced(kind="as-built", mirrors=mirrors, camera=camera)


@pytest.fixture(scope="module")
def small_set() -> Set:
    nominal = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
    truth = draw(nominal, seed=4)
    frames, base = [], []
    for number, turn in enumerate(TURNS_DEG):
        frames.append(render(truth.camera, truth, BOARD, mirrored_pose(number), noise_grey=NOISE_GREY, seed=number))
        bare = posed(BOARD, np.array([0.0, 0.0, 200.0 + 15 * number]), np.array(turn), direct=True)
        base.append(render(truth.camera, None, BOARD, bare, noise_grey=NOISE_GREY, seed=100 + number))
    judged = nominal.replaced(verdict={"blocked_light": Metric(value=0.0, unit="of the light", limit=0.0)})
    return Set(judged, truth, frames, base)


@pytest.fixture(scope="module")
def detections(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that caches detected corners, so that no picture is searched twice."""
    return tmp_path_factory.mktemp("detections")


@pytest.fixture(scope="module")
def corners(small_set: Set, detections: Path) -> tuple[list[Observations], list[Observations]]:
    """The corners of the frames with and without mirrors, for tests of the solver alone."""
    find = partial(detect_frames, layout=small_set.nominal, board=BOARD, folder=detections)
    seen, base = find(small_set.frames, mirrored=True), find(small_set.base, mirrored=False)
    return [frame.corners for frame in seen], [frame.corners for frame in base]


@pytest.fixture(scope="module")
def calibrated(small_set: Set, detections: Path) -> Calibration:
    return calibrate(small_set.frames, small_set.base, small_set.nominal, BOARD, detections=detections)


@pytest.fixture(scope="module")
def plain_frames(small_set: Set) -> list[Grey]:
    """Two frames of a checkerboard of 9 x 6 squares via the mirrors."""
    return [
        render(small_set.truth.camera, small_set.truth, PLAIN, posed(PLAIN, np.array(at), np.array(turn), direct=False))
        for at, turn in (([0.0, 330.0, 85.0], [10.0, 12.0, 20.0]), ([10.0, 350.0, 80.0], [-15.0, 20.0, 0.0]))
    ]


def test_a_calibrated_layout_does_not_keep_the_verdict_on_its_design(small_set: Set, calibrated: Calibration) -> None:
    assert small_set.nominal.verdict
    assert calibrated.layout.verdict == {}


def angles_deg(a: Layout, b: Layout) -> FloatArray:
    crosses = np.cross([m.normal_in_rig for m in a.mirrors], [m.normal_in_rig for m in b.mirrors])
    return np.degrees(np.linalg.norm(crosses, axis=1))


def test_the_truth_is_found_from_the_nominal_layout(small_set: Set, calibrated: Calibration) -> None:
    assert angles_deg(small_set.nominal, small_set.truth).max() > 0.2
    assert angles_deg(calibrated.layout, small_set.truth).max() < 0.02
    for found, true in zip(calibrated.layout.mirrors, small_set.truth.mirrors, strict=True):
        assert found.distance_mm == pytest.approx(true.distance_mm, abs=0.1)
    assert calibrated.layout.camera.fx_px == pytest.approx(684.0, abs=0.5)
    assert calibrated.layout.kind == "calibrated"
    for axis in "xy":
        assert calibrated.metrics[f"held_out_rms_{axis}_px"].value < 0.1
    assert calibrated.metrics["held_out_spatial_rms_mm"].value < 0.1
    assert [note for note in calibrated.notes if "pupil" not in note] == []


def test_errors_match_the_layouts_uncertainties(small_set: Set, calibrated: Calibration) -> None:
    sigmas = mirror_sigmas(calibrated.layout)
    tilts = np.radians(angles_deg(calibrated.layout, small_set.truth))
    for (tilt, distance), error, found, true in zip(
        sigmas, tilts, calibrated.layout.mirrors, small_set.truth.mirrors, strict=True
    ):
        assert 0 < error < 5 * tilt * np.sqrt(2)
        assert 0 < abs(found.distance_mm - true.distance_mm) < 5 * distance


def test_a_calibrated_layout_is_unchanged_by_saving(calibrated: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "layout.json"
    calibrated.layout.save(path)
    assert Layout.load(path) == calibrated.layout
    uncertainty = calibrated.layout.uncertainty
    assert uncertainty is not None
    assert uncertainty.parameters[:2] == ("fx_px", "fy_px")
    assert "mirror 3 z_mm" in uncertainty.parameters
    assert (np.linalg.eigvalsh(uncertainty.covariance) > 0).all()


def test_same_pictures_same_bytes(
    small_set: Set, calibrated: Calibration, corners: tuple[list[Observations], list[Observations]]
) -> None:
    again = calibrate_corners(*corners, small_set.nominal, BOARD.corners_in_board_mm)
    assert again.layout.model_dump_json() == calibrated.layout.model_dump_json()


def test_picture_files_are_read_on_demand(small_set: Set, tmp_path: Path) -> None:
    picture = tmp_path / "small.png"
    write_image(picture, np.zeros((30, 40), dtype=np.uint8))
    with pytest.raises(InputError, match=r"small\.png: 40x30 px, expected 960x540 of the layout's camera"):
        calibrate([picture, tmp_path / "missing.png"], [], small_set.nominal, BOARD)
    with pytest.raises(InputError, match=r"missing\.png"):
        calibrate([tmp_path / "missing.png"], [], small_set.nominal, BOARD)


@pytest.mark.slow
def test_damaged_pictures_are_left_out_named_and_counted(small_set: Set, tmp_path: Path) -> None:
    frames, base = list(small_set.frames), list(small_set.base)
    paths = [tmp_path / "frame.png", tmp_path / "base.jpg"]
    for path in paths:
        write_image(path, frames[0])
        path.write_bytes(path.read_bytes()[:-1000])
    complete = calibrate(frames, base, small_set.nominal, BOARD)
    found = calibrate([*frames[:2], paths[0], *frames[2:]], [paths[1], *base], small_set.nominal, BOARD)
    assert found.metrics["damaged_pictures"].value == 2
    assert "damaged_pictures" not in complete.metrics
    for path in paths:
        assert f"{path}: image is truncated; not used" in found.notes
    assert np.array_equal(found.residuals_px, complete.residuals_px)


def test_without_a_readable_picture_the_first_damaged_one_is_named(small_set: Set, tmp_path: Path) -> None:
    path = tmp_path / "recording.mp4"
    path.write_bytes(b"a video")
    with pytest.raises(
        InputError, match=r"recording\.mp4: not an image .*; no corner of the board found in other frames"
    ):
        calibrate([path], [], small_set.nominal, BOARD)


def test_corners_match_the_truth(small_set: Set) -> None:
    pose = mirrored_pose(0)
    seen = detect_sub_images(small_set.frames[0], small_set.nominal, BOARD).corners
    points = transform(pose, BOARD.corners_in_board_mm)
    for mirror in range(4):
        rows = seen.view == mirror
        assert rows.sum() > 15
        error = small_set.truth.project(points[seen.corner[rows]], mirror) - seen.pixels[rows]
        assert np.sqrt(np.mean(error**2)) < 0.06


def test_a_plain_board_has_the_same_numbers_in_all_views(small_set: Set) -> None:
    even = Checkerboard(cols=8, rows=6, square_mm=9.0)
    pose = posed(even, np.array([0.0, 330.0, 85.0]), np.array([10.0, 12.0, 20.0]), direct=False)
    seen = detect_sub_images(
        render(small_set.truth.camera, small_set.truth, even, pose), small_set.nominal, even
    ).corners
    assert sorted(set(seen.view.tolist())) == [0, 1, 2, 3]
    points = transform(pose, even.corners_in_board_mm)
    way_up = set()
    for mirror in range(4):
        rows = seen.view == mirror
        expected = small_set.truth.project(points[seen.corner[rows]], mirror)
        turned = small_set.truth.project(points[::-1][seen.corner[rows]], mirror)
        errors = [float(np.abs(p - seen.pixels[rows]).max()) for p in (expected, turned)]
        assert min(errors) < 0.3
        way_up.add(int(np.argmin(errors)))
    assert len(way_up) == 1


@pytest.mark.parametrize(("cols", "rows"), [(6, 9), (8, 7)])
def test_a_plain_board_with_rows_and_columns_exchanged_is_the_same_board(small_set: Set, cols: int, rows: int) -> None:
    drawn = Checkerboard(cols=9, rows=6, square_mm=9.0) if cols == 6 else Checkerboard(cols=7, rows=8, square_mm=9.0)
    exchanged = Checkerboard(cols=cols, rows=rows, square_mm=9.0)
    assert (exchanged.cols, exchanged.rows) == (drawn.rows, drawn.cols)
    pose = posed(drawn, np.array([0.0, 330.0, 85.0]), np.array([10.0, 12.0, 20.0]), direct=False)
    frame = render(small_set.truth.camera, small_set.truth, drawn, pose)
    seen = detect_sub_images(frame, small_set.nominal, exchanged).corners
    assert sorted(set(seen.view.tolist())) == [0, 1, 2, 3]
    points = transform(pose, drawn.corners_in_board_mm)
    places = {}
    for mirror in range(4):
        rows_of = seen.view == mirror
        apart = small_set.truth.project(points, mirror)[None] - seen.pixels[rows_of][:, None]
        distance = np.linalg.norm(apart, axis=2)
        assert distance.min(axis=1).max() < 0.3
        places[mirror] = dict(zip(seen.corner[rows_of].tolist(), distance.argmin(axis=1).tolist(), strict=True))
    # In either orientation, it is the same in all mirrors, and a rigid rotation of the drawn board.
    for corner in set.intersection(*(set(found) for found in places.values())):
        assert len({found[corner] for found in places.values()}) == 1
    shared = sorted(places[0])
    was, now = drawn.corners_in_board_mm[[places[0][c] for c in shared]], exchanged.corners_in_board_mm[shared]
    spans = [np.linalg.norm(a[:, None] - a[None], axis=2) for a in (was, now)]
    np.testing.assert_allclose(spans[0], spans[1], atol=1e-9)


@pytest.mark.parametrize(("cols", "rows"), [(10, 6), (9, 7), (12, 9)])
def test_a_plain_board_of_more_squares_than_the_picture_shows_is_not_found(
    small_set: Set, plain_frames: list[Grey], cols: int, rows: int
) -> None:
    assert len(detect_sub_images(plain_frames[0], small_set.nominal, PLAIN).corners)
    found = r"no corner of the board found in any of 1 frames|the pictures show a checkerboard of 9 x 6 squares"
    with pytest.raises(InputError, match=found):
        calibrate(plain_frames[:1], [], small_set.nominal, Checkerboard(cols=cols, rows=rows, square_mm=9.0))


@pytest.mark.parametrize(("cols", "rows", "said"), [(9, 5, "a checkerboard of 9 x 6 squares"), (7, 5, "")])
def test_a_plain_board_of_fewer_squares_than_the_picture_shows_is_rejected(
    small_set: Set, plain_frames: list[Grey], cols: int, rows: int, said: str
) -> None:
    with pytest.raises(InputError) as refused:
        calibrate(plain_frames, [], small_set.nominal, Checkerboard(cols=cols, rows=rows, square_mm=9.0))
    assert said in str(refused.value)


def test_pictures_that_are_upside_down_are_refused_with_that_cause(small_set: Set) -> None:
    turned = [np.ascontiguousarray(picture[::-1, ::-1]) for picture in small_set.frames[:3]]
    with pytest.raises(InputError, match="only when rotated by 180 deg"):
        calibrate(turned, [], small_set.nominal, BOARD)


@pytest.mark.parametrize("base", [0, 1])
def test_no_pictures_are_refused_in_one_line(small_set: Set, base: int) -> None:
    with pytest.raises(InputError, match="no pictures given"):
        calibrate([], small_set.base[:base], small_set.nominal, BOARD)


@pytest.mark.parametrize("model", ["joint+turn", "second_surface"])
def test_a_model_for_other_pictures_is_refused_before_any_is_searched(
    small_set: Set, tmp_path: Path, model: str
) -> None:
    with pytest.raises(InputError, match="model: "):
        calibrate([tmp_path / "nowhere.png"], [], small_set.nominal, BOARD, model=RequestedModel.parse(model))


def test_insufficient_pictures_are_refused_in_one_line(small_set: Set) -> None:
    blank = np.full_like(small_set.frames[0], 60)
    assert len(detect_sub_images(blank, small_set.nominal, BOARD).corners) == 0
    with pytest.raises(InputError, match="no corner of the board found in any of 2 frames"):
        calibrate([blank, blank], small_set.base, small_set.nominal, BOARD)
    with pytest.raises(InputError, match="frame 0 is 100x50 px, the layout's camera 960x540"):
        calibrate([blank[:50, :100]], small_set.base, small_set.nominal, BOARD)
    hidden = small_set.frames[0].copy()
    hidden[:270, :480] = 0
    with pytest.raises(InputError, match="mirror 1-0 shows 0 corners in 1 frames, expected 20"):
        calibrate([hidden], small_set.base, small_set.nominal, BOARD)


@pytest.mark.slow
def test_two_base_frames_are_used_although_they_determine_no_camera(small_set: Set, detections: Path) -> None:
    found = calibrate(small_set.frames, small_set.base[:2], small_set.nominal, BOARD, detections=detections)
    assert len(found.rig_from_board) == len(small_set.frames) + 2
    assert found.layout.camera.fx_px == pytest.approx(small_set.truth.camera.fx_px, rel=0.01)


@pytest.mark.slow
def test_a_layout_with_the_wrong_coating_raises_an_alarm(small_set: Set, detections: Path) -> None:
    second = small_set.nominal.replaced(
        mirrors=tuple(mirror.replaced(surface="second") for mirror in small_set.nominal.mirrors)
    )
    found = calibrate(small_set.frames, small_set.base, second, BOARD, detections=detections)
    assert found.diagnostics is not None
    assert found.diagnostics.model_name == "joint+sheet"
    assert any("appear to be first-surface" in alarm for alarm in found.diagnostics.alarms)


def test_a_wrong_board_is_named_before_all_pictures_are_searched(
    small_set: Set, monkeypatch: pytest.MonkeyPatch
) -> None:
    def search(*_: object, **__: object) -> None:
        raise AssertionError("searched all pictures")

    monkeypatch.setattr(calibration, "detect_frames", search)
    seen, base, nominal = small_set.frames, small_set.base, small_set.nominal
    with pytest.raises(InputError, match="show a ChArUco board of 16 columns of squares"):
        calibrate(seen, base, nominal, BOARD.replaced(cols=14))
    with pytest.raises(InputError, match="show a ChArUco board of 16 columns of squares"):
        calibrate(seen, [], nominal, PLAIN)
    with pytest.raises(InputError, match="are exchanged, as the board's markers show: swap them"):
        calibrate(base, seen, nominal, BOARD)


def grey(level: int) -> Grey:
    return np.full((48, 64), level, np.uint8)


def test_damaged_files_are_named_and_others_of_another_size_refused(tmp_path: Path) -> None:
    good, cut, small = (tmp_path / name for name in ("good.png", "cut.png", "small.png"))
    write_image(good, grey(90))
    cut.write_bytes(good.read_bytes()[:-20])
    write_image(small, grey(90)[:30])
    taken = PictureReader(TINY_CAMERA)
    read = list(taken.read([good, cut, grey(50)], mirrored=True))
    assert [None if picture is None else int(picture.mean()) for picture in read] == [90, None, 50]
    assert [str(error).startswith(f"{cut}: ") for error in taken.damaged] == [True]
    with pytest.raises(InputError, match="64x30 px, expected 64x48 of the layout's camera"):
        list(taken.read([small], mirrored=False))


def test_the_first_pictures_of_each_kind_are_searched_for_other_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = PictureReader(TINY_CAMERA)
    list(taken.read([grey(10), grey(20), grey(30), grey(40)], mirrored=True))
    list(taken.read([grey(50)], mirrored=False))
    changes = taken.extremes.changes()
    assert changes is not None
    assert int(changes[0].max()) == 30  # those without mirrors do not count
    requests: list[tuple[list[int], bool, bool, bool]] = []

    def other(pictures: list[Grey], board: object, *, mirrored: bool, found: bool, fits: bool) -> str | None:
        requests.append(([int(picture.mean()) for picture in pictures], mirrored, found, fits))
        return "another board" if mirrored and not fits else None

    monkeypatch.setattr(calibration, "other_board", other)
    taken.check_board(TINY_BOARD, mirrored=True, base=False, fits=True)
    assert requests == [([50], False, True, False), ([10, 20], True, True, True)]
    with pytest.raises(InputError, match="another board"):
        taken.check_board(TINY_BOARD, mirrored=False, base=True, fits=False)
