"""One frame made by a worker: from a task as text to files as bytes."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.sets.frame_task import (
    CaptureSetup,
    FrameTask,
    render_frame,
    render_frame_in_turn,
    render_frame_on_one_core,
)
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.settings import SENSORS, RendererName, RenderSettings, SensorModel
from mirrorcam.render_scenes.truth.corners import CornerProjector
from mirrorcam.render_scenes.variant import CUDA
from tests.render_scenes.corners import MARGIN_PX, TARGET, locate, photographed, tilted_board, windows

PLAIN = SensorModel(read_noise_grey=0.0)
RENDERERS: list[RendererName] = ["fast", "mitsuba"]
FOCAL_PX, WIDTH_PX, HEIGHT_PX = 400.0, 320, 240


def task_of(layout: Layout, board: Charuco, sensor: SensorModel, **settings: object) -> FrameTask:
    changed = RenderSettings(renderer="fast", sensor=sensor).replaced(**settings)
    poses = plan_frames(layout, board, 2, np.random.default_rng(1)).poses[:1]
    return FrameTask(
        setup=CaptureSetup(built=layout, mirrors=True, board=board, settings=changed),
        name=f"frames/0000{changed.suffix}",
        map_name="truth/maps/frames/0000.exr" if changed.maps else None,
        poses=poses,
        key=(0, 3, 0),
    )


def picture_of(files: dict[str, bytes]) -> NDArray[np.uint8]:
    (content,) = (content for name, content in files.items() if name.startswith("frames"))
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED), dtype=np.uint8)


def test_a_frame_is_a_picture_and_its_maps(small_layout: Layout, small_board: Charuco, tmp_path: Path) -> None:
    task = task_of(small_layout, small_board, SENSORS["c920"])
    files = render_frame(task.model_dump_json())
    assert set(files) == {"frames/0000.jpg", "truth/maps/frames/0000.exr"}
    picture = picture_of(files)
    assert picture.shape == (270, 480)
    assert picture.dtype == np.uint8
    (tmp_path / "maps.exr").write_bytes(files["truth/maps/frames/0000.exr"])
    with OpenEXR.File(str(tmp_path / "maps.exr"), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: channel.pixels.copy() for name, channel in file.channels().items()}
    assert np.array(json.loads(header["rig_from_board"])).tolist() == task.poses.tolist()
    assert header["layout"] == small_layout.identity
    assert RenderSettings.model_validate_json(header["settings"]) == task.setup.settings
    # At its corners the board is at the points of the maps.
    px, visible = CornerProjector(small_layout, small_board).via_mirrors(task.poses[0])
    assert visible.sum() > 100
    for mirror, corner in np.argwhere(visible):
        column, row = np.rint(px[mirror, corner]).astype(int)
        at = np.array([channels["board.x"][row, column], channels["board.y"][row, column]])
        assert channels["mirror"][row, column] == mirror
        # A pixel spans some 3 mm of the board.
        assert np.abs(at - small_board.corners_in_board_mm[corner, :2]).max() < 3.0


@pytest.mark.parametrize("how", [render_frame_on_one_core, render_frame_in_turn])
def test_whoever_renders_it_a_frame_has_the_same_bytes(how: object, small_layout: Layout, small_board: Charuco) -> None:
    assert callable(how)
    task = task_of(small_layout, small_board, SENSORS["poor"], maps=False).model_dump_json()
    files = render_frame(task)
    assert how(task) == files
    assert render_frame(task) == files


def test_a_worker_renders_by_the_variant_it_is_told_or_not_at_all(
    small_layout: Layout, small_board: Charuco, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Different variants differ in their last bits.
    monkeypatch.setattr("mirrorcam.render_scenes.variant.has_gpu", lambda: False)
    task = task_of(small_layout, small_board, PLAIN, maps=False)
    elsewhere = task.replaced(setup=task.setup.replaced(variant=CUDA))
    with pytest.raises(InputError, match="variant cuda_ad_mono needs a GPU"):
        render_frame(elsewhere.model_dump_json())


def test_threads_that_ask_at_once_get_their_own_frames(small_layout: Layout, small_board: Charuco) -> None:
    first = task_of(small_layout, small_board, SENSORS["c920"], maps=False)
    poses = plan_frames(small_layout, small_board, 8, np.random.default_rng(2)).poses
    tasks = [first.replaced(poses=pose[None], key=(0, 3, n)).model_dump_json() for n, pose in enumerate(poses)]
    with ThreadPoolExecutor(max_workers=4) as pool:
        together = list(pool.map(render_frame_in_turn, tasks))
    assert together == [render_frame(task) for task in tasks]
    assert len({tuple(files.items()) for files in together}) == 8


@pytest.mark.slow
def test_jpeg_and_h264_lose_more_the_lower_their_quality(small_layout: Layout, small_board: Charuco) -> None:
    def loss(**compression: int) -> float:
        task = task_of(small_layout, small_board, PLAIN.replaced(**compression), maps=False)
        return float(np.square(picture_of(render_frame(task.model_dump_json())).astype(float) - perfect).mean())

    perfect = picture_of(render_frame(task_of(small_layout, small_board, PLAIN, maps=False).model_dump_json()))
    assert loss() == 0.0
    assert loss(h264_crf=0) == 0.0
    assert 0.0 < loss(jpeg_quality=95) < loss(jpeg_quality=70) < loss(jpeg_quality=30)
    assert 0.0 < loss(h264_crf=15) < loss(h264_crf=30) < loss(h264_crf=45)


@pytest.mark.slow
def test_what_goes_into_a_video_is_compressed_there(small_layout: Layout, small_board: Charuco) -> None:
    sensor = PLAIN.replaced(h264_crf=30)
    still = render_frame(task_of(small_layout, small_board, sensor, maps=False).model_dump_json())
    moving = render_frame(task_of(small_layout, small_board, sensor, maps=False, video="mp4").model_dump_json())
    lossless = render_frame(task_of(small_layout, small_board, PLAIN, maps=False).model_dump_json())
    assert picture_of(moving).tobytes() == picture_of(lossless).tobytes() != picture_of(still).tobytes()


def bare_camera(board: Checkerboard, renderer: RendererName, poses: FloatArray, default_layout: Layout) -> FrameTask:
    """A frame of a camera without mirrors or flaws."""
    camera = Camera(
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        fx_px=FOCAL_PX,
        fy_px=FOCAL_PX,
        cx_px=(WIDTH_PX - 1) / 2.0,
        cy_px=(HEIGHT_PX - 1) / 2.0,
    )
    settings = RenderSettings(renderer=renderer, spp=64, sensor=PLAIN, maps=False)
    setup = CaptureSetup(built=default_layout.replaced(camera=camera), mirrors=False, board=board, settings=settings)
    return FrameTask(setup=setup, name="frames/0000.png", map_name=None, poses=poses, key=(0,))


def edges_px(row: NDArray[np.uint8]) -> FloatArray:
    """Column at which a row of pixels crosses the mean of black and white."""
    values = row.astype(np.float64) - (row.min() / 2.0 + row.max() / 2.0)
    at = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    return np.asarray(at + values[at] / (values[at] - values[at + 1]))


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_rolling_shutter_shears_what_moves_across_by_speed_times_readout(
    renderer: RendererName, default_layout: Layout
) -> None:
    # Stripes 500 mm away, moving to the right by 1 m/s while 30 ms are read out.
    board = Checkerboard(cols=9, rows=3, square_mm=100.0)
    speed_mm_per_ms, readout_ms, distance = 1.0, 30.0, 500.0
    moved_mm = speed_mm_per_ms * readout_ms * np.array([-0.5, 0.0, 0.5])
    poses = rigid(np.eye(3), np.outer(moved_mm, [1.0, 0.0, 0.0]) + np.array([-450.0, -150.0, distance]))
    still, moving = (
        picture_of(render_frame(bare_camera(board, renderer, given, default_layout).model_dump_json()))
        for given in (poses[1:2], poses)
    )
    # Rows of the middle squares alone, a whole number of the reference's strips; each row is read
    # readout / (rows - 1) after the one above.
    rows = np.arange(88, 152)
    per_row_px = FOCAL_PX / distance * speed_mm_per_ms * readout_ms / (HEIGHT_PX - 1)
    shifts = np.array([np.mean(edges_px(moving[row])[:4] - edges_px(still[row])[:4]) for row in rows])
    slope, offset = np.polyfit(rows - (HEIGHT_PX - 1) / 2.0, shifts, 1)
    assert slope == pytest.approx(per_row_px, rel=0.02)
    assert offset == pytest.approx(0.0, abs=0.1)  # the middle row is where the board is halfway


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_rolling_shutter_stretches_what_moves_along_with_it(renderer: RendererName, default_layout: Layout) -> None:
    # Horizontal stripes: row v shows what is at v - c = f (y + speed t) / z at its time t = readout (v - c) / (h - 1).
    board = Checkerboard(cols=3, rows=21, square_mm=40.0)
    speed_mm_per_ms, readout_ms, distance = 2.0, 30.0, 500.0
    moved_mm = speed_mm_per_ms * readout_ms * np.array([-0.5, 0.0, 0.5])
    poses = rigid(np.eye(3), np.outer(moved_mm, [0.0, 1.0, 0.0]) + np.array([-60.0, -420.0, distance]))
    still, moving = (
        picture_of(render_frame(bare_camera(board, renderer, given, default_layout).model_dump_json()))
        for given in (poses[1:2], poses)
    )
    middle, centre = WIDTH_PX // 2, (HEIGHT_PX - 1) / 2.0
    before = edges_px(still[:, middle]) - centre
    after = edges_px(moving[:, middle]) - centre
    stretch = 1.0 / (1.0 - FOCAL_PX / distance * speed_mm_per_ms * readout_ms / (HEIGHT_PX - 1))
    inner = np.abs(before * stretch) < centre - 10.0
    expected = before[inner] * stretch
    nearest = after[np.abs(after[:, None] - expected).argmin(axis=0)]
    assert stretch > 1.2
    assert len(expected) >= 4
    # The reference exposes eight rows at once.
    assert np.abs(nearest - expected).max() < (0.1 if renderer == "fast" else 4.0 * (stretch - 1.0) + 0.1)


def moved_while_read(pose: FloatArray) -> FloatArray:
    """Three poses (3, 4, 4) around one: 12 mm and 2 degrees from the first row to the last, and not evenly."""
    poses = np.array([pose] * 3)
    poses[:, :3, 3] += np.outer([-1.0, 0.1, 1.0], [4.0, 3.0, -4.0])
    turn = Rotation.from_rotvec([0.006, -0.012, 0.01]).as_matrix()
    poses[0, :3, :3] = pose[:3, :3] @ turn.T
    poses[2, :3, :3] = pose[:3, :3] @ turn
    return poses


@pytest.mark.slow
def test_corners_of_a_moving_board_are_where_the_truth_says(default_layout: Layout) -> None:
    poses = moved_while_read(tilted_board(default_layout))
    scene = FastScene(default_layout.camera, default_layout.mirrors, TARGET, RenderSettings(renderer="fast"))
    scene.place_board(*poses)
    light = scene.render()
    projector = CornerProjector(default_layout, TARGET)
    (px, visible), (still, _) = projector.during_readout(poses), projector.via_mirrors(poses[1])
    steps = []
    for axis in (0, 1):
        moved = rigid(np.eye(3), 0.1 * np.eye(3)[axis])
        steps.append(projector.during_readout(poses @ moved)[0] - px)
    errors, moves = [], []
    for mirror in (0, 4, 8):
        x, y, width, height = windows(default_layout)[mirror]
        picture = photographed(light[2 * y : 2 * (y + height), 2 * x : 2 * (x + width)], 2)
        for corner in np.flatnonzero(visible[mirror]):
            expected = px[mirror, corner] - [x, y]
            if (expected < MARGIN_PX).any() or (expected > np.array([width, height]) - MARGIN_PX).any():
                continue
            dark_first = sum(divmod(int(corner), TARGET.cols - 1)) % 2 == 0
            tangents = np.stack([step[mirror, corner] for step in steps])
            errors.append(locate(picture, expected, tangents, dark_first) - expected)
            moves.append(px[mirror, corner] - still[mirror, corner])
    assert len(errors) > 20
    assert np.abs(moves).max() > 5.0
    assert np.abs(errors).max() < 0.02


@pytest.mark.parametrize("renderer", RENDERERS)
def test_maps_tell_what_each_row_shows_when_it_is_read(
    renderer: RendererName, small_layout: Layout, small_board: Charuco, tmp_path: Path
) -> None:
    task = task_of(small_layout, small_board, PLAIN, renderer=renderer, spp=4)
    poses = moved_while_read(task.poses[0])
    moving = render_frame(task.replaced(poses=poses).model_dump_json())
    (tmp_path / "maps.exr").write_bytes(moving["truth/maps/frames/0000.exr"])
    with OpenEXR.File(str(tmp_path / "maps.exr"), separate_channels=True) as file:
        x, y = (file.channels()[name].pixels.copy() for name in ("board.x", "board.y"))
    # Well inside the image of a mirror: at its edge the lens blurs in the dark around it.
    inside = cv2.erode((np.isfinite(x) & np.isfinite(y)).astype(np.uint8), np.ones((7, 7))).astype(bool)
    # Black and white, as the print at these places is, and as the picture shows away from edges.
    texels = 8
    print_px = np.pad(small_board.image(texels * 12), texels * 12, constant_values=255)
    per_mm = texels * 12 / small_board.square_mm
    at = [np.clip(((v[inside] + small_board.square_mm) * per_mm).astype(int), 0, None) for v in (y, x)]
    soft = cv2.blur(print_px, (texels * 8, texels * 8))[np.minimum(at[0], len(print_px) - 1), at[1]]
    picture = picture_of(moving)[inside]
    assert (soft < 5).sum() > 300
    assert picture[soft < 5].max() < 60
    assert picture[soft > 250].min() > 150
