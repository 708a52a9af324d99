"""Both array backends give the same result for each operation.

The renderer by formula: against a float64 projection, against the reference, against rays through every pixel.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.boards import board_from_texels, printed_radiance
from mirrorcam.render_scenes.fast.analytic_scene import Arithmetic, DrJitArithmetic, FastScene, NumpyArithmetic
from mirrorcam.render_scenes.lens import true_camera, with_pupil_of
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorName
from mirrorcam.render_scenes.truth.corners import CornerProjector
from mirrorcam.render_scenes.variant import SCALAR, use_variant
from tests.render_scenes.corners import MARGIN_PX, TARGET, errors_by_mirror, photographed, tilted_board, windows


@pytest.fixture(params=["numpy", "drjit"])
def xp(request: pytest.FixtureRequest) -> Arithmetic:
    if request.param == "numpy":
        return NumpyArithmetic()
    if use_variant() == SCALAR:
        pytest.skip("nothing compiles here")
    return DrJitArithmetic()


def test_operations_are_those_of_float32(xp: Arithmetic) -> None:
    a, b = np.array([[0.25, 4.0, 2.75], [1.0, 1.0, 9.0]], dtype=np.float32)
    x, y = xp.load(a), xp.load(b)
    np.testing.assert_array_equal(np.array(xp.minimum(x, y)), np.minimum(a, b))
    np.testing.assert_array_equal(np.array(xp.maximum(x, y)), np.maximum(a, b))
    np.testing.assert_array_equal(np.array(xp.sqrt(x)), np.sqrt(a))
    np.testing.assert_array_equal(np.array(xp.where(x > y, x, 0.0)), [0.0, 4.0, 0.0])
    np.testing.assert_array_equal(np.array(xp.truncate(x)), [0, 4, 2])
    np.testing.assert_array_equal(np.array(xp.to_float(xp.truncate(x))), [0.0, 4.0, 2.0])
    (half,) = xp.scalars([0.5])
    np.testing.assert_array_equal(np.array(x * half), a / 2)


def test_values_are_gathered_and_scattered(xp: Arithmetic) -> None:
    table = xp.load(np.array([10.0, 20.0, 30.0], dtype=np.float32))
    index = xp.load(np.array([2, 0], dtype=np.uint32))
    canvas = xp.zeros(4)
    xp.scatter(canvas, index + xp.index(1), xp.gather(table, index))
    np.testing.assert_array_equal(xp.to_numpy(canvas), [0.0, 10.0, 0.0, 30.0])


SETTINGS = RenderSettings(renderer="fast", sensor=SENSORS["ideal"])
CUT = SETTINGS.subpixels


def seen(scene: FastScene, layout: Layout) -> dict[int, FloatArray]:
    """The window of each mirror."""
    radiance, pictures = scene.render(), {}
    for index, (x, y, width, height) in enumerate(windows(layout)):
        rows, columns = (
            slice(CUT * (at - MARGIN_PX), CUT * (at + length + MARGIN_PX)) for at, length in ((y, height), (x, width))
        )
        inner = slice(MARGIN_PX, -MARGIN_PX)
        pictures[index] = photographed(radiance[rows, columns], CUT)[inner, inner]
    return pictures


def test_corners_agree_with_the_projection(distorted_layout: Layout) -> None:
    pose = tilted_board(distorted_layout)
    scene = FastScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, SETTINGS)
    scene.place_board(pose)
    errors = errors_by_mirror(seen(scene, distorted_layout), windows(distorted_layout), distorted_layout, pose)
    for index, error in errors.items():
        assert len(error) >= 6, index
        assert np.linalg.norm(error.mean(axis=0)) <= 0.002, (index, error.mean(axis=0))
    assert np.sqrt(np.mean(np.concatenate(list(errors.values())) ** 2)) < 0.005


@pytest.mark.slow
def test_it_agrees_with_the_reference(distorted_layout: Layout) -> None:
    """One window of one board by both renderers: corners, and flat areas."""
    pose = tilted_board(distorted_layout)
    crops = {index: windows(distorted_layout)[index] for index in (0, 4, 7)}
    fast = FastScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, SETTINGS)
    fast.place_board(pose)
    reference = BoardScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, SETTINGS)
    reference.place_board(pose)
    radiance = fast.render()
    pictures: dict[str, dict[int, FloatArray]] = {"fast": {}, "reference": {}}
    for index, (x, y, width, height) in crops.items():
        window = radiance[CUT * y : CUT * (y + height), CUT * x : CUT * (x + width)]
        traced = reference.render(spp=64, seed=1, subpixels=CUT, crop=(x, y, width, height))
        flat = (window == cv2.dilate(window, np.ones((3, 3)))) & (window == cv2.erode(window, np.ones((3, 3))))
        assert flat.mean() > 0.5
        np.testing.assert_allclose(traced[flat], window[flat], rtol=0.005)
        pictures["fast"][index], pictures["reference"][index] = photographed(window, CUT), photographed(traced, CUT)
    errors = [errors_by_mirror(found, windows(distorted_layout), distorted_layout, pose) for found in pictures.values()]
    for index in crops:
        assert np.abs(errors[0][index] - errors[1][index]).max() <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize("flaw", [{"pupil_walk_mm": 5.0, "focus_mm": 2000.0}, {"lens_waves_px": 1.0}])
def test_a_real_lens_moves_corners_as_traced_rays_do(distorted_layout: Layout, flaw: dict[str, float]) -> None:
    """By both renderers: a pupil that walks by 5 mm at 45 degrees, and waves of a pixel."""
    pose = tilted_board(distorted_layout)
    settings = SETTINGS.replaced(sensor=SENSORS["ideal"].replaced(**flaw))
    camera = with_pupil_of(distorted_layout.camera, settings.sensor)
    real = distorted_layout.replaced(camera=true_camera(camera, settings.sensor))
    shift = CornerProjector(real, TARGET).via_mirrors(pose)[0]
    assert np.sqrt(np.nanmean((shift - CornerProjector(distorted_layout, TARGET).via_mirrors(pose)[0]) ** 2)) > 0.7
    fast = FastScene(real.camera, real.mirrors, TARGET, settings)
    reference = BoardScene(real.camera, real.mirrors, TARGET, settings)
    for scene in (fast, reference):
        scene.place_board(pose)
    crops = windows(distorted_layout)
    by_fast = seen(fast, distorted_layout)
    traced = {k: reference.render(spp=64, seed=1, subpixels=CUT, crop=crops[k]) for k in (0, 2)}
    by_reference = {k: photographed(picture, CUT) for k, picture in traced.items()}
    for pictures, limit in ((by_fast, 0.002), (by_reference, 0.006)):
        for index, error in errors_by_mirror(pictures, crops, real, pose).items():
            assert len(error) >= 6, index
            assert np.linalg.norm(error.mean(axis=0)) <= limit, (index, error.mean(axis=0))


WHITE = Checkerboard(cols=6, rows=5, square_mm=300.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ink", "sensor", "limit"), [(1.0, "c920", 0.002), (0.05, "c920", 0.002), (0.05, "poor", 0.005)]
)
def test_light_through_parts_of_the_pupil_agrees_with_the_reference(
    default_layout: Layout, ink: float, sensor: SensorName, limit: float
) -> None:
    """Profiles across the edges of mirrors out of focus, in front of a white board and of ones with corners."""
    settings = SETTINGS.replaced(sensor=SENSORS[sensor], paper=1.0, ink=ink, mirror_reflectance=1.0)
    board = WHITE if ink == 1.0 else Checkerboard(cols=30, rows=24, square_mm=15.0)
    turn = default_layout.view_from_rig.T
    half = np.array([board.cols, board.rows, 0.0]) * board.square_mm / 2.0
    pose = rigid(turn, 380.0 * turn[:, 2] - turn @ half)
    fast = FastScene(default_layout.camera, default_layout.mirrors, board, settings)
    reference = BoardScene(default_layout.camera, default_layout.mirrors, board, settings)
    x, y, width, height = 600, 300, 120, 90  # where four mirrors meet
    pictures = []
    for scene in (fast, reference):
        scene.place_board(pose)
    pictures = [
        photographed(picture, CUT)[4:-4, 4:-4]
        for picture in (
            fast.render()[CUT * y : CUT * (y + height), CUT * x : CUT * (x + width)],
            reference.render(spp=256, seed=1, subpixels=CUT, crop=(x, y, width, height)),
        )
    ]
    error = pictures[0] - pictures[1]
    assert np.sqrt(np.mean(error**2)) < limit
    assert abs(error.mean()) < 0.0005
    assert pictures[0].min() < (0.8 if ink == 1.0 else 0.2)


def test_a_tilted_board_is_as_sharp_as_its_print(small_layout: Layout, small_board: Charuco) -> None:
    """The horizon of the board's plane is in the picture, where a subpixel covers many squares beyond the board."""
    camera = small_layout.camera.replaced(distortion=np.zeros(5))
    turn = Rotation.from_euler("x", 65.0, degrees=True).as_matrix()
    centre = np.array([small_board.cols, small_board.rows, 0.0]) * small_board.square_mm / 2.0
    pose = rigid(turn, np.array([0.0, 0.0, 150.0]) - turn @ centre)
    scene = FastScene(camera, (), small_board, SETTINGS)
    scene.place_board(pose)
    rows, columns = slice(0, CUT * camera.height_px, 7), slice(0, CUT * camera.width_px, 7)
    rendered = scene.render()[rows, columns]
    printed, texels = printed_radiance(small_board, SETTINGS), np.linalg.inv(board_from_texels(small_board))
    traced = np.zeros_like(rendered)
    cuts = (np.arange(4) + 0.5) / 4.0
    for down, right in itertools.product(cuts, cuts):
        x, y = np.meshgrid(
            (np.arange(CUT * camera.width_px)[columns] + right) / CUT - 0.5,
            (np.arange(CUT * camera.height_px)[rows] + down) / CUT - 0.5,
        )
        rays = np.stack([(x - camera.cx_px) / camera.fx_px, (y - camera.cy_px) / camera.fy_px, np.ones_like(x)], axis=2)
        depth = (pose[:3, 3] @ turn[:, 2]) / (rays @ turn[:, 2])
        on_board = (rays * depth[:, :, None] - pose[:3, 3]) @ turn
        column, row = np.moveaxis(np.floor(on_board[:, :, :2] @ texels[:2, :2].T + texels[:2, 2]).astype(int), 2, 0)
        on_print = (depth > 0) & (row >= 0) & (column >= 0) & (row < printed.shape[0]) & (column < printed.shape[1])
        traced[on_print] += printed[row[on_print], column[on_print]] / 16.0
    assert (traced > 0.0).mean() > 0.2
    assert np.sqrt(np.mean((rendered - traced)[traced > 0.0] ** 2)) < 0.02


def test_numpy_renders_the_same(small_layout: Layout, small_board: Charuco) -> None:
    pose = plan_frames(small_layout, small_board, 1, np.random.default_rng(1)).poses[0]
    pictures = []
    for variant in (None, SCALAR):
        scene = FastScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS, variant=variant)
        scene.place_board(pose)
        pictures.append(scene.render())
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1e-4)
    assert np.ptp(pictures[0]) > 0.5


def test_a_moving_board_is_sheared_by_a_rolling_shutter(small_layout: Layout, small_board: Charuco) -> None:
    """Every row shows the board at the pose of its readout time."""
    start = plan_frames(small_layout, small_board, 1, np.random.default_rng(1)).poses[0]
    poses = [start.copy() for _ in range(3)]
    for part, pose in enumerate(poses):
        pose[:3, 3] += 10.0 * part * small_layout.view_from_rig[0]
    scene = FastScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS)
    scene.place_board(*poses)
    rolling = scene.render()
    rows = len(rolling)
    for row in (0, rows // 3, rows - 1):
        now = start.copy()
        pixel = (row + 0.5) / CUT - 0.5
        now[:3, 3] += 20.0 * pixel / (small_layout.camera.height_px - 1) * small_layout.view_from_rig[0]
        scene.place_board(now)
        np.testing.assert_allclose(rolling[row], scene.render()[row], atol=2e-3)


def test_only_the_first_frame_compiles(small_layout: Layout, small_board: Charuco) -> None:
    import drjit as dr

    scene = FastScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS)
    poses = plan_frames(small_layout, small_board, 3, np.random.default_rng(1)).poses
    scene.place_board(poses[0])
    scene.render()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for pose in poses[1:]:
            scene.place_board(pose)
            scene.render()
        kernels = [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]
    assert kernels
    assert all(entry["cache_hit"] for entry in kernels)


def test_a_board_that_shows_its_back_is_black(small_layout: Layout) -> None:
    board = Checkerboard(cols=10, rows=7, square_mm=24.0)
    pose = plan_frames(small_layout, board, 1, np.random.default_rng(1)).poses[0]
    scene = FastScene(small_layout.camera, small_layout.mirrors, board, SETTINGS)
    scene.place_board(pose)
    assert scene.render().max() > 0.5
    scene.place_board(pose @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    assert not scene.render().any()
