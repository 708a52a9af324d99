"""The request for a synthetic calibration set, its streams of random numbers, and the board's pose in each frame."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from pydantic import Field

from mirrorcam.core.arguments import PathField
from mirrorcam.core.bounds import PICTURES, SEED
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry.boards import CalibrationBoard, default_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.boards import smooth_motion
from mirrorcam.render_scenes.sets.poses import PosePlan, evaluate_plan, plan_frames
from mirrorcam.render_scenes.settings import POSES_HZ, RATE_HZ, RenderSettings


class Stream(IntEnum):
    """Streams of random numbers; each is independent of the number of draws from the others."""

    AS_BUILT = 0
    POSES = 1
    BASE_POSES = 2
    FRAMES = 3
    BASE = 4
    FINISH = 5


class SetRequest(Value):
    """All inputs that determine the files of a rendered set.

    Parameters
    ----------
    layout
        Nominal layout; the set is rendered with an as-built copy, drawn with `tolerances`.
    board
        Board in the pictures.
    frames, base_frames
        Number of pictures via the mirrors, and with the bare camera.
    seed
        Seed of the as-built copy, the poses and the noise.
    tolerances
        Deviations of the as-built copy from the nominal layout.
    settings
        Renderer, light and sensor, and whether pixel maps and a video are written.
    poses
        Poses (n, 4, 4) of the board, in the rig frame, mm, instead of planned ones.
    poses_hz
        Number of poses per second of a motion.
    rate_hz
        Frame rate of a motion. If given, the pictures are samples of one smooth path through the poses.
    parts
        Folder with the parts of the device (`build_parts`) around the mirrors.
    """

    layout: Layout
    board: CalibrationBoard = Field(default_factory=default_board)
    frames: int = PICTURES.narrowed(min=1).field(20)
    base_frames: int = PICTURES.field(10)
    seed: int = SEED.field(0)
    tolerances: Tolerances = Tolerances()
    settings: RenderSettings = RenderSettings()
    poses: tuple[tuple[tuple[float, ...], ...], ...] = ()
    poses_hz: float = POSES_HZ.field(1.0)
    rate_hz: float | None = RATE_HZ.field(None)
    parts: PathField | None = None

    def random(self, stream: Stream) -> np.random.Generator:
        """Return the random generator of a stream."""
        return np.random.default_rng(np.random.SeedSequence((self.seed, stream)))


def planned_frames(request: SetRequest) -> tuple[PosePlan, FloatArray]:
    """Plan the board's pose in each frame, and its poses (frames, 1 or 3, 4, 4) during the readout of each."""
    layout, board, random = request.layout, request.board, request.random(Stream.POSES)
    keys = np.array(request.poses)
    if request.rate_hz is not None and (len(keys) or request.frames) == 1:
        raise InputError("rate_hz: one pose is not a motion, expected two frames or more")
    if request.rate_hz is None:
        plan = evaluate_plan(layout, board, keys) if len(keys) else plan_frames(layout, board, request.frames, random)
        return plan, plan.poses[:, None]
    if len(keys):
        count = int((len(keys) - 1) / request.poses_hz * request.rate_hz) + 1
        if count > PICTURES.max:
            raise InputError(f"poses: their motion takes {count} frames, expected {PICTURES.max} or fewer")
    else:
        count = request.frames
        seconds = (count - 1) / request.rate_hz
        keys = plan_frames(layout, board, int(np.ceil(seconds * request.poses_hz)) + 1, random).poses
    half_s = request.settings.sensor.readout_ms / 2000.0
    offsets_s = np.array([-half_s, 0.0, half_s] if half_s > 0 else [0.0])
    times = np.arange(count)[:, None] / request.rate_hz + offsets_s
    readouts = smooth_motion(keys, times.ravel() * request.poses_hz).reshape(count, len(offsets_s), 4, 4)
    return evaluate_plan(layout, board, readouts[:, len(offsets_s) // 2]), readouts
