"""Render one frame of a set in a worker: the task is JSON text, the result the bytes of its files."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mirrorcam.core.images.pictures import encoded_image
from mirrorcam.core.values import FloatArray, Shaped, Value
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.boards import poses_at
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.lens import true_camera
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.reference.device_bodies import BodyObstacles, DeviceParts, read_device
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.sets.video import as_key_frame
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.truth.pixel_maps import (
    CHANNELS,
    PixelRays,
    board_maps,
    exr_bytes,
    pixel_rays,
)
from mirrorcam.render_scenes.variant import use_variant

# Rows that the reference renders with one pose under a rolling shutter: 0.2 ms of a webcam's readout.
STRIP_ROWS = 8


class CaptureSetup(Value):
    """Setup shared by a set's frames: the device as built, or its bare camera; the board; the settings."""

    built: Layout
    mirrors: bool
    board: CalibrationBoard
    settings: RenderSettings
    finishes: tuple[MirrorFinish, ...] = Field(
        default=(), description="surface finishes of the mirrors; empty: uniform"
    )
    parts: DeviceParts | None = Field(default=None, description="parts around the mirrors")
    variant: str | None = Field(
        default=None, description="Mitsuba's variant, the same for all workers; None: the fastest"
    )


class FrameTask(Value):
    """One frame: poses (1 or 3, 4, 4) of the board in the rig frame, mm, and the key of its random numbers.

    With a rolling shutter, the three poses are at the readout of the first, middle and last row.
    """

    setup: CaptureSetup
    name: str
    map_name: str | None
    poses: Annotated[FloatArray, Shaped((None, 4, 4))]
    key: tuple[int, ...] = Field(min_length=1)


class _SetRenderer:
    """Renderer of a setup, with the traced rays of its pixels."""

    def __init__(self, setup: CaptureSetup) -> None:
        settings = setup.settings
        built = setup.built.replaced(camera=true_camera(setup.built.camera, settings.sensor))
        mirrors = built.mirrors if setup.mirrors else ()
        bodies = () if setup.parts is None else read_device(setup.parts)
        self.scene: FastScene | BoardScene
        if settings.renderer == "fast":
            self.scene = FastScene(
                built.camera, mirrors, setup.board, settings, finishes=setup.finishes, variant=setup.variant
            )
        else:
            self.scene = BoardScene(
                built.camera,
                mirrors,
                setup.board,
                settings,
                finishes=setup.finishes,
                bodies=bodies,
                variant=setup.variant,
            )
        self.settings = settings
        obstacles = BodyObstacles(bodies) if bodies else None
        self.rays = (
            pixel_rays(
                built,
                mirrors=setup.mirrors,
                finishes=setup.finishes,
                obstacles=obstacles,
            )
            if settings.maps
            else None
        )

    def radiance(self, poses: FloatArray, seed: int) -> NDArray[np.float32]:
        """Return the radiance (h * subpixels, w * subpixels) of a frame with board poses (1 or 3, 4, 4)."""
        if isinstance(self.scene, FastScene):
            self.scene.place_board(*poses)
            return self.scene.render()
        subpixels = self.settings.subpixels
        spp = self.settings.spp // subpixels**2
        if len(poses) == 1:
            self.scene.place_board(poses[0])
            return self.scene.render(spp=spp, subpixels=subpixels, seed=seed)
        camera = self.scene.camera
        strips = []
        rows = np.arange(0, camera.height_px, STRIP_ROWS)
        heights = np.minimum(STRIP_ROWS, camera.height_px - rows)
        strip_poses = poses_at(poses, (rows + (heights - 1) / 2.0) / (camera.height_px - 1))
        for row, height, pose in zip(rows.tolist(), heights.tolist(), strip_poses, strict=True):
            self.scene.place_board(pose)
            window = (0, row, camera.width_px, height)
            strips.append(self.scene.render(spp=spp, subpixels=subpixels, seed=seed, crop=window))
        return np.concatenate(strips)


@lru_cache(maxsize=2)
def _set_renderer(setup_json: str) -> _SetRenderer:
    # Two setups: one for frames via the mirrors, one for the bare camera.
    return _SetRenderer(CaptureSetup.model_validate_json(setup_json))


def render_frame(task_json: str) -> dict[str, bytes]:
    """Return the files of one frame by their names in the set; their bytes depend only on the task."""
    task = FrameTask.model_validate_json(task_json)
    setup, settings = task.setup, task.setup.settings
    renderer = _set_renderer(setup.model_dump_json())
    key = np.random.SeedSequence(task.key)
    radiance = renderer.radiance(task.poses, seed=int(key.generate_state(1)[0]))
    picture = photograph(
        radiance,
        settings.subpixels,
        setup.built.camera,
        settings.sensor,
        np.random.default_rng(key.spawn(1)[0]),
    )
    files = {task.name: _compressed(picture, settings)}
    if task.map_name is not None and renderer.rays is not None:
        maps = _maps(renderer.rays, setup.board, task.poses)
        header = {"rig_from_board": json.dumps(task.poses.tolist()), "layout": setup.built.identity, "units": "mm"}
        header |= {"target": setup.board.model_dump_json(), "settings": settings.model_dump_json()}
        files[task.map_name] = exr_bytes(maps, header)
    return files


def _maps(rays: PixelRays, board: CalibrationBoard, poses: FloatArray) -> dict[str, FloatArray]:
    """Return the maps of a board with poses (1 or 3, 4, 4), each row at its readout time."""
    if len(poses) == 1:
        return board_maps(rays, board, poses[0])
    fields = (rays.mirror, rays.start, rays.direction, rays.path_before_mm, rays.distance_to_body_mm)
    count = len(rays.mirror)
    row_poses = poses_at(poses, np.arange(count) / (count - 1))
    rows = [
        board_maps(PixelRays(*(field[row : row + 1] for field in fields)), board, pose)
        for row, pose in enumerate(row_poses)
    ]
    return {name: np.concatenate([row[name] for row in rows]) for name in CHANNELS}


def render_frame_on_one_core(task_json: str) -> dict[str, bytes]:
    """Call `render_frame` on one thread, for pools with one process per core."""
    use_variant(FrameTask.model_validate_json(task_json).setup.variant)
    import drjit

    drjit.set_thread_count(1)
    cv2.setNumThreads(1)
    return render_frame(task_json)


def render_frame_in_turn(task_json: str) -> dict[str, bytes]:
    """Call `render_frame` from one of several threads, in sequence: a scene has one pose at a time."""
    return _one_thread().submit(render_frame, task_json).result()


@cache
def _one_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=1)


def _compressed(picture: NDArray[np.uint8], settings: RenderSettings) -> bytes:
    """Encode a picture with the compression of the sensor."""
    sensor = settings.sensor
    if sensor.jpeg_quality is not None:
        return encoded_image(picture, settings.suffix, sensor.jpeg_quality)
    # The video compresses its own frames, with prediction between them.
    if sensor.h264_crf is not None and settings.video is None:
        picture = as_key_frame(picture, sensor.h264_crf)
    return encoded_image(picture, settings.suffix)
