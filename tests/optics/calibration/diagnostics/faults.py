"""Simulated corners of a mirror camera with one fault each, of twelve kinds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.causes import Cause, CauseKind, ranked_causes
from mirrorcam.optics.calibration.diagnostics.nested_models import fit_as
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.lens import WavyCamera
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT, behind_glass, bent
from tests.optics.calibration.synthetic_corners import as_built, direct_poses, mirrored_poses, views_of
from tests.optics.layouts import faceted_parabola

NOISE_PX = 0.02
MIRRORED, DIRECT_FRAMES = 12, 6
Corners = Callable[[Layout, list[FloatArray], list[FloatArray], np.random.Generator], list[Observations]]


@dataclass(frozen=True)
class Faulty:
    """A set of corners, the cause that should come first, and the causes found."""

    kind: CauseKind | None
    name: str
    causes: list[Cause]

    @property
    def right(self) -> bool:
        first = self.causes[0] if self.causes else None
        if self.kind is None or first is None:
            return first is None and self.kind is None
        return first.kind == self.kind and self.name in ("", first.name)


def device(seed: int) -> Layout:
    random = np.random.default_rng(seed)
    rows, cols = ((2, 2), (2, 3), (3, 3), (1, 3))[seed % 4]
    camera = Camera.c920()
    spec = DesignSpec(camera=camera, rows=rows, cols=cols)
    return as_built(faceted_parabola(camera, spec, fill=0.9), seed=int(random.integers(1000)))


def plain(truth: Layout, mirrored: list[FloatArray], direct: list[FloatArray], *, board=BOARD) -> list[Observations]:
    views = views_of(truth, board, mirrored, direct, noise_px=0.0)
    return [frame.shifted(number) for number, frame in enumerate([*views.seen, *views.base])]


def faulty(kind: CauseKind | None, seed: int) -> Faulty:
    """Simulate a fault, fit the joint model and rank the causes of its misfit."""
    random = np.random.default_rng([seed, 7])
    truth = device(seed)
    mirrored = mirrored_poses(BOARD, MIRRORED, tilt_deg=30, seed=seed + 100)
    direct = direct_poses(BOARD, DIRECT_FRAMES, tilt_deg=30, seed=seed + 200)
    name = ""
    size = random.uniform(0.5, 1.5)
    mirrors = len(truth.mirrors)
    if kind is None:
        frames = plain(truth, mirrored, direct)
    elif kind == "picture":
        frames = plain(truth, mirrored, direct)
        number = int(random.integers(MIRRORED))
        name = f"frame {number}"
        frame = frames[number]
        pixels = frame.pixels.copy()
        for view in np.unique(frame.view):
            of_view = frame.view == view
            centred = (pixels[of_view] - pixels[of_view].mean(axis=0)) / 100.0
            pixels[of_view] += 0.2 * size * random.standard_normal(2) + centred @ (0.1 * size * random.standard_normal((2, 2)))
        frames[number] = replace(frame, pixels=pixels)
    elif kind == "mirror moved":
        number, first = int(random.integers(mirrors)), int(random.integers(3, MIRRORED - 3))
        name = truth.mirror_names[number]
        mirror = truth.mirrors[number]
        rotation = Rotation.from_rotvec(np.radians(0.02 * size) * random.standard_normal(3)).as_matrix()
        moved = mirror.moved(rotation, 0.01 * size * mirror.normal_in_rig)
        after = truth.replaced(mirrors=tuple(moved if i == number else m for i, m in enumerate(truth.mirrors)))
        frames = [a if n < first else b for n, (a, b) in enumerate(zip(plain(truth, mirrored, direct), plain(after, mirrored, direct)))]
    elif kind == "mirror bent":
        number = int(random.integers(mirrors))
        name = truth.mirror_names[number]
        all_bent = bent(truth, 0.001 * size, seed=seed)
        truth = truth.replaced(mirrors=tuple(all_bent.mirrors[i] if i == number else m for i, m in enumerate(truth.mirrors)))
        frames = plain(truth, mirrored, direct)
    elif kind == "bend":
        frames = plain(bent(truth, 0.001 * size, seed=seed), mirrored, direct)
    elif kind == "lens":
        camera = truth.camera.replaced(lens_model="rational", distortion=[*truth.camera.distortion, 0.2 * size, 0.1, 0.05 * size])
        frames = plain(truth.replaced(camera=camera), mirrored, direct)
    elif kind == "spline":
        frames = plain(truth.replaced(camera=WavyCamera(**truth.camera.model_dump(), waves_px=0.05 * size)), mirrored, direct)
    elif kind == "pupil":
        frames = plain(truth.replaced(camera=truth.camera.replaced(pupil_walk_mm=0.2 * size)), mirrored, direct)
    elif kind == "shutter":
        frames = shuttered(truth, mirrored, direct, size, random)
    elif kind == "plate":
        frames = plain(behind_glass(truth, 2.0 * size), mirrored, direct)
    elif kind in ("warp", "size"):
        frames = shaped(truth, mirrored, direct, kind, size)
    else:
        camera = truth.camera
        other = camera.replaced(fx_px=camera.fx_px * (1 + 0.001 * size), fy_px=camera.fy_px * (1 + 0.001 * size), cx_px=camera.cx_px + size)
        frames = [a if n < MIRRORED else b for n, (a, b) in enumerate(zip(plain(truth, mirrored, direct), plain(truth.replaced(camera=other), mirrored, direct)))]
    return ranked(truth, kind, name, frames, [*mirrored, *direct], random)


def shuttered(truth, mirrored, direct, size, random):
    frames = plain(truth, mirrored, direct)
    poses = [*mirrored, *direct]
    step = 1e-3
    result = []
    for number, frame in enumerate(frames):
        velocity = np.concatenate([0.05 * size * random.standard_normal(3) * 0.02, size * 0.3 * random.standard_normal(3)])
        moved = []
        for sign in (1.0, -1.0):
            pose = poses[number].copy()
            pose[:3, :3] = Rotation.from_rotvec(sign * step * velocity[:3]).as_matrix() @ pose[:3, :3]
            pose[:3, 3] += sign * step * velocity[3:]
            every = list(poses)
            every[number] = pose
            moved.append(plain(truth, every[: len(mirrored)], every[len(mirrored):])[number])
        a, b = moved
        keys = [{(v, c): p for v, c, p in zip(o.view.tolist(), o.corner.tolist(), o.pixels)} for o in (a, b)]
        keep = np.array([(v, c) in keys[0] and (v, c) in keys[1] for v, c in zip(frame.view.tolist(), frame.corner.tolist())])
        frame = frame.where(keep)
        slope = np.array([(keys[0][v, c] - keys[1][v, c]) / (2 * step) for v, c in zip(frame.view.tolist(), frame.corner.tolist())])
        time = frame.pixels[:, 1:] / truth.camera.height_px - 0.5
        result.append(replace(frame, pixels=frame.pixels + slope * time))
    return result


def shaped(truth, mirrored, direct, kind, size):
    class Board(type(BOARD)):
        @property
        def corners_in_board_mm(self):
            drawn = BOARD.corners_in_board_mm.copy()
            x = drawn[:, 0] - drawn[:, 0].mean()
            if kind == "size":
                drawn[:, 0] += 0.001 * size * x
            else:
                drawn[:, 2] += 0.2 * size * (x / np.abs(x).max()) ** 2
            return drawn
    return plain(truth, mirrored, direct, board=Board(**BOARD.model_dump()))


def ranked(truth, kind, name, frames, poses, random) -> Faulty:
    kept = [n for n, frame in enumerate(frames) if len(frame)]
    clean = Observations.join([replace(frames[n], frame=np.full(len(frames[n]), place)) for place, n in enumerate(kept)])
    observations = replace(clean, pixels=clean.pixels + NOISE_PX * random.standard_normal(clean.pixels.shape), sigma_px=np.full(len(clean), NOISE_PX))
    start = Estimate.of(truth.camera if truth.camera.lens_model == "brown_conrady" else truth.camera, truth.mirrors, np.array([poses[n] for n in kept]))
    start = replace(start, thickness_mm=np.zeros(len(truth.mirrors)), refractive_index=np.ones(len(truth.mirrors)), curvature_per_m=np.zeros((len(truth.mirrors), 3)))
    fitted = fit_as("joint", start, observations, JOINT)
    names = [f"frame {n}" for n in kept]
    return Faulty(kind, name, ranked_causes(fitted, observations, names, truth.mirror_names))
