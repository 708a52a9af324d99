"""Simulated corners of mirror cameras with one fault each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.causes import ranked_causes
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_as
from mirrorcam.optics.calibration.diagnostics.score_test import Cause, CauseKind
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.lens import WavyCamera
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, behind_glass, bent
from tests.optics.calibration.synthetic_corners import as_built, direct_poses, mirrored_poses, views_of
from tests.optics.layouts import faceted_parabola

NOISE_PX = 0.02
MIRRORED, DIRECT = 12, 6
GRIDS = (2, 2), (2, 3), (3, 3), (1, 3)
STEP = 1e-3


@dataclass(frozen=True)
class Setup:
    """A device as built, the poses of a board, and a random size of the fault, about 1."""

    truth: Layout
    mirrored: list[FloatArray]
    direct: list[FloatArray]
    size: float
    random: np.random.Generator

    @classmethod
    def of(cls, seed: int) -> Setup:
        random = np.random.default_rng([seed, 7])
        camera = Camera.c920()
        rows, cols = GRIDS[seed % len(GRIDS)]
        nominal = faceted_parabola(camera, DesignSpec(camera=camera, rows=rows, cols=cols), fill=0.9)
        return cls(
            as_built(nominal, seed=seed),
            mirrored_poses(BOARD, MIRRORED, tilt_deg=30, seed=seed + 100),
            direct_poses(BOARD, DIRECT, tilt_deg=30, seed=seed + 200),
            float(random.uniform(0.5, 1.5)),
            random,
        )

    def frames(self, layout: Layout | None = None, board: Charuco = BOARD) -> list[Observations]:
        """The corners of each frame without noise, for the truth or for a different layout or board."""
        views = views_of(layout or self.truth, board, self.mirrored, self.direct, noise_px=0.0)
        return [frame.with_frame_offset(number) for number, frame in enumerate([*views.mirrored, *views.base])]


class Misprinted(Charuco):
    """A board that is `stretched` along x, and bowed along x with a sag of `sag_mm` at its edges."""

    stretched: float = 0.0
    sag_mm: float = 0.0

    @cached_property
    def corners_in_board_mm(self) -> FloatArray:
        corners = super().corners_in_board_mm.copy()
        x = corners[:, 0] - corners[:, 0].mean()
        corners[:, 0] += self.stretched * x
        corners[:, 2] += self.sag_mm * (x / np.abs(x).max()) ** 2
        return corners


Fault = Callable[[Setup], tuple[list[Observations], int | None]]


def picture(setup: Setup) -> tuple[list[Observations], int | None]:
    """Corners of one picture are wrong, in each view by an affine field."""
    frames, number = setup.frames(), int(setup.random.integers(MIRRORED))
    pixels = frames[number].pixels.copy()
    for view in np.unique(frames[number].view):
        of_view = frames[number].view == view
        centred = (pixels[of_view] - pixels[of_view].mean(axis=0)) / 100.0
        pixels[of_view] += 0.2 * setup.size * setup.random.standard_normal(2)
        pixels[of_view] += centred @ (0.1 * setup.size * setup.random.standard_normal((2, 2)))
    frames[number] = replace(frames[number], pixels=pixels)
    return frames, number


def mirror_moved(setup: Setup) -> tuple[list[Observations], int | None]:
    truth = setup.truth
    number, first = int(setup.random.integers(len(truth.mirrors))), int(setup.random.integers(3, MIRRORED - 3))
    rotation = Rotation.from_rotvec(np.radians(0.02 * setup.size) * setup.random.standard_normal(3)).as_matrix()
    mirrors = list(truth.mirrors)
    mirrors[number] = mirrors[number].moved(rotation, 0.01 * setup.size * mirrors[number].normal_in_rig)
    after = setup.frames(truth.replaced(mirrors=tuple(mirrors)))
    return [*setup.frames()[:first], *after[first:]], number


def mirror_bent(setup: Setup) -> tuple[list[Observations], int | None]:
    truth, number = setup.truth, int(setup.random.integers(len(setup.truth.mirrors)))
    mirrors = list(truth.mirrors)
    mirrors[number] = bent(truth, 0.001 * setup.size, seed=number).mirrors[number]
    return setup.frames(truth.replaced(mirrors=tuple(mirrors))), number


def bend(setup: Setup) -> tuple[list[Observations], int | None]:
    return setup.frames(bent(setup.truth, 0.001 * setup.size)), None


def lens(setup: Setup) -> tuple[list[Observations], int | None]:
    camera = setup.truth.camera
    divisor = [0.2 * setup.size, 0.1, 0.05 * setup.size]
    rational = camera.replaced(lens_model="rational", distortion=[*camera.distortion, *divisor])
    return setup.frames(setup.truth.replaced(camera=rational)), None


def spline(setup: Setup) -> tuple[list[Observations], int | None]:
    wavy = WavyCamera(**setup.truth.camera.model_dump(), waves_px=0.05 * setup.size)
    return setup.frames(setup.truth.replaced(camera=wavy)), None


def pupil(setup: Setup) -> tuple[list[Observations], int | None]:
    walking = setup.truth.camera.replaced(pupil_walk_mm=0.4 * setup.size)
    return setup.frames(setup.truth.replaced(camera=walking)), None


def colour(setup: Setup) -> tuple[list[Observations], int | None]:
    growing = setup.truth.camera.replaced(defocus_growth_mm2=100.0 * setup.size)
    return setup.frames(setup.truth.replaced(camera=growing)), None


def plate(setup: Setup) -> tuple[list[Observations], int | None]:
    return setup.frames(behind_glass(setup.truth, 2.0 * setup.size)), None


def warp(setup: Setup) -> tuple[list[Observations], int | None]:
    return setup.frames(board=Misprinted(**BOARD.model_dump(), sag_mm=0.2 * setup.size)), None


def bow(setup: Setup) -> tuple[list[Observations], int | None]:
    """The board sags differently in each picture."""
    sags = 0.2 * setup.size * setup.random.standard_normal(MIRRORED + DIRECT)
    boards = [Misprinted(**BOARD.model_dump(), sag_mm=sag) for sag in sags]
    return [setup.frames(board=board)[number] for number, board in enumerate(boards)], None


def board_changed(setup: Setup) -> tuple[list[Observations], int | None]:
    """The board sags before one of the pictures with mirrors, and stays so."""
    first = int(setup.random.integers(1, MIRRORED))
    after = setup.frames(board=Misprinted(**BOARD.model_dump(), sag_mm=0.3 * setup.size))
    return [*setup.frames()[:first], *after[first:]], first


def size(setup: Setup) -> tuple[list[Observations], int | None]:
    return setup.frames(board=Misprinted(**BOARD.model_dump(), stretched=0.001 * setup.size)), None


def focus(setup: Setup) -> tuple[list[Observations], int | None]:
    camera, factor = setup.truth.camera, 1.0 + 0.001 * setup.size
    other = camera.replaced(fx_px=factor * camera.fx_px, fy_px=factor * camera.fy_px, cx_px=camera.cx_px + setup.size)
    return [*setup.frames()[:MIRRORED], *setup.frames(setup.truth.replaced(camera=other))[MIRRORED:]], None


def refocused(setup: Setup) -> tuple[list[Observations], int | None]:
    """Focus changes by 0.3 to 1 % before one of the pictures with mirrors."""
    camera, first = setup.truth.camera, int(setup.random.integers(1, MIRRORED))
    factor = 1.0 + setup.random.choice([-1.0, 1.0]) * setup.random.uniform(0.003, 0.01)
    other = camera.replaced(fx_px=factor * camera.fx_px, fy_px=factor * camera.fy_px)
    return [*setup.frames()[:first], *setup.frames(setup.truth.replaced(camera=other))[first:]], first


def shutter(setup: Setup) -> tuple[list[Observations], int | None]:
    """The board moves by some tenths of a mm while a frame is read."""
    frames = []
    for number, frame in enumerate(setup.frames()):
        rotation, shift = 1e-3 * setup.random.standard_normal(3), 0.3 * setup.random.standard_normal(3)
        ahead, behind = (
            _moved_board(setup, number, sign * STEP * setup.size * rotation, sign * STEP * setup.size * shift)
            for sign in (1.0, -1.0)
        )
        corners = list(zip(frame.view.tolist(), frame.corner.tolist(), strict=True))
        kept = np.array([corner in ahead and corner in behind for corner in corners], dtype=bool)
        velocity = [(ahead[c] - behind[c]) / (2.0 * STEP) for c, keep in zip(corners, kept, strict=True) if keep]
        frame = frame.where(kept)
        time = frame.pixels[:, 1:] / setup.truth.camera.height_px - 0.5
        frames.append(replace(frame, pixels=frame.pixels + np.array(velocity).reshape(-1, 2) * time))
    return frames, None


def _moved_board(
    setup: Setup, number: int, rotation: FloatArray, shift: FloatArray
) -> dict[tuple[int, int], FloatArray]:
    """Pixels of a frame's corners, by view and corner, with the board moved."""
    poses = [*setup.mirrored, *setup.direct]
    pose = poses[number].copy()
    pose[:3, :3] = Rotation.from_rotvec(rotation).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += shift
    poses[number] = pose
    frame = replace(setup, mirrored=poses[:MIRRORED], direct=poses[MIRRORED:]).frames()[number]
    return dict(zip(zip(frame.view.tolist(), frame.corner.tolist(), strict=True), frame.pixels, strict=True))


FAULTS: dict[str, Fault] = {
    "picture": picture,
    "mirror moved": mirror_moved,
    "mirror bent": mirror_bent,
    "bend": bend,
    "lens": lens,
    "spline": spline,
    "pupil": pupil,
    "colour": colour,
    "shutter": shutter,
    "plate": plate,
    "warp": warp,
    "bow": bow,
    "board changed": board_changed,
    "size": size,
    "focus": focus,
    "refocused": refocused,
}
KINDS: dict[str, CauseKind] = {"refocused": "focus"}
"""Kinds of cause of the faults that are not named after theirs."""


def causes_of(fault: str | None, seed: int) -> tuple[list[Cause], int | None]:
    """Rank the causes of a fault, or of none; also return the index of the frame or mirror at fault."""
    fitted, observations, index = fitted_with(fault, seed)
    return ranked_causes(fitted, observations), index


def fitted_with(fault: str | None, seed: int) -> tuple[Fitted, Observations, int | None]:
    """Fit `joint` to corners with a fault; also return the index of the frame or mirror at fault."""
    setup = Setup.of(seed)
    frames, index = (setup.frames(), None) if fault is None else FAULTS[fault](setup)
    shown = [number for number, frame in enumerate(frames) if len(frame)]
    observations = noisy_corners([frames[number] for number in shown], setup.random)
    poses = [*setup.mirrored, *setup.direct]
    start = Estimate.of(setup.truth.camera, setup.truth.mirrors, np.array([poses[number] for number in shown]))
    fitted = fit_as("joint", start, observations, JOINT)
    if fault in ("picture", "board changed", "refocused"):
        index = None if index is None else sum(number < index for number in shown)
    return fitted, observations, index


def noisy_corners(frames: Sequence[Observations], random: np.random.Generator) -> Observations:
    """Number the frames from 0, and add noise."""
    clean = Observations.join(
        [replace(frame, frame=np.full(len(frame), number)) for number, frame in enumerate(frames)]
    )
    pixels = clean.pixels + NOISE_PX * random.standard_normal(clean.pixels.shape)
    return replace(clean, pixels=pixels, sigma_px=np.full(len(clean), NOISE_PX))
