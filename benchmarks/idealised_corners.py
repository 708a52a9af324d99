"""The effect of idealisations on corners, and what is left of it after a calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import held_out_metrics
from mirrorcam.optics.calibration.diagnostics.model_selection import select_model
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_as_built
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.render_scenes.mirror_finish import draw_finishes
from mirrorcam.render_scenes.sets.poses import plan_base_frames
from mirrorcam.render_scenes.sets.set_request import SetRequest, Stream, planned_frames
from mirrorcam.render_scenes.settings import RenderSettings, SurfaceFinish
from mirrorcam.render_scenes.truth.corners import Oracle
from mirrorcam.render_scenes.truth.light_rays import image_px

NOISE_PX = 0.01
"""Of found corners, per axis: what blind sets of sensor c920 show."""

Project = Callable[[int, int, FloatArray], FloatArray]
"""Pixels (n, 2) of points (n, 3) in rig, of a frame via a mirror or `DIRECT`."""


@dataclass(frozen=True)
class Calibrated:
    """Normals (m, 3) and held-out RMS, px per axis, of a calibration."""

    normals: FloatArray
    held_out_px: float


@dataclass(frozen=True)
class Effect:
    """Size of an idealisation: of corners, px RMS per axis; of the worst normal, degrees; of held-out corners, px."""

    corners_px: float
    normals_deg: float
    held_out_px: float


class Setup:
    """The default device as built, and the poses of the board before it, of seed 0.

    Frames are numbered through: first those via the mirrors, then those of the bare camera.
    """

    def __init__(self, frames: int = 20, base_frames: int = 10) -> None:
        self.request = SetRequest(layout=design(DesignSpec(fold_deg=90.0)), frames=frames, base_frames=base_frames)
        layout, random = self.request.layout, self.request.random
        self.built: Layout = draw_as_built(layout, self.request.tolerances, random(Stream.AS_BUILT))
        self.corners_mm = self.request.target.corners_in_board_mm
        base = plan_base_frames(layout, self.request.target, base_frames, random(Stream.BASE_POSES)).poses
        self.poses = np.concatenate([planned_frames(self.request)[1][:, 0], base])
        oracle = Oracle(self.built, self.request.target)
        self.visible: list[dict[int, NDArray[np.intp]]] = []
        for number, pose in enumerate(self.poses):
            if number < frames:
                seen = oracle.by_mirrors(pose)[1]
                self.visible.append({k: np.flatnonzero(seen[k]) for k in range(len(seen))})
            else:
                self.visible.append({DIRECT: np.flatnonzero(oracle.direct(pose)[1])})
        self.true = self.corners_by(self.projected)

    def projected(self, frame: int, view: int, points: FloatArray) -> FloatArray:
        """Pixels without any effect."""
        return image_px(self.built.camera, None if view == DIRECT else self.built.mirrors[view], points)

    def corners_by(self, project: Project, bent: Callable[[FloatArray], FloatArray] = np.asarray) -> Observations:
        """Corners of all frames, as seen by a projection; `bent` moves the points (n, 3) of the board."""
        drawn = bent(self.corners_mm)
        parts = []
        for frame, (pose, views) in enumerate(zip(self.poses, self.visible, strict=True)):
            points = transform(pose, drawn)
            for view, corner in views.items():
                parts.append(Observations.of_view(frame, view, corner, project(frame, view, points[corner])))
        return Observations.join(parts)

    def calibrated(self, seen: Observations) -> Calibrated:
        """Calibrate from corners of all frames, with whatever model they support, started at the truth."""
        centres = self.built.virtual_centres_in_rig_mm.reshape(-1, 3)
        selected = select_model(Estimate(self.built.camera, centres, self.poses), seen, self.corners_mm)
        estimate = selected.solution.estimate
        metrics = held_out_metrics(selected.solution, seen, selected.model, mirrored_frames=self.request.frames)
        held_out = np.sqrt(np.mean([metrics[f"held_out_rms_{axis}_px"].value ** 2 for axis in "xy"]))
        found = estimate.virtual_centres_in_rig_mm
        return Calibrated(found / np.linalg.norm(found, axis=1, keepdims=True), float(held_out))

    def noisy(self, seen: Observations) -> Observations:
        """Corners with the noise of a detector, the same in all calls."""
        noise = np.random.default_rng(0).normal(0.0, NOISE_PX, seen.pixels.shape)
        return Observations(seen.frame, seen.view, seen.corner, seen.pixels + noise)

    def effect(self, seen: Observations, plain: Calibrated) -> Effect:
        """Effect of corners that were seen elsewhere than they truly are, beside a calibration from the true ones."""
        return beside(plain, self.calibrated(self.noisy(seen)), self.moved_px(seen))

    def drift(self, seen: Observations, turned_deg: float) -> Effect:
        """Effect of corners that have moved since the calibration, by mirrors that turned."""
        return Effect(self.moved_px(seen), turned_deg, self.moved_px(seen))

    def moved_px(self, seen: Observations) -> float:
        """RMS per axis from where the corners truly are."""
        return float(np.sqrt(np.mean((seen.pixels - self.true.pixels) ** 2)))


def beside(plain: Calibrated, other: Calibrated, moved_px: float) -> Effect:
    """Effect by two calibrations with the same noise."""
    sines = np.linalg.norm(np.cross(plain.normals, other.normals), axis=1)
    more = np.sqrt(max(other.held_out_px**2 - plain.held_out_px**2, 0.0))
    return Effect(moved_px, float(np.degrees(sines.max())), float(more))


def walking_pupil(setup: Setup, walk_mm: float) -> Observations:
    """A pupil that moves along the axis, by ray tracing in float64."""
    pupil = RenderSettings().sensor.replaced(pupil_walk_mm=walk_mm).pupil

    def project(frame: int, view: int, points: FloatArray) -> FloatArray:
        mirror = None if view == DIRECT else setup.built.mirrors[view]
        return image_px(setup.built.camera, mirror, points, pupil=pupil)

    return setup.corners_by(project)


def other_lens(setup: Setup, rms_px: float) -> Observations:
    """A lens that is off its model by smooth waves of half the sensor's width."""
    camera = setup.built.camera

    def project(frame: int, view: int, points: FloatArray) -> FloatArray:
        px = setup.projected(frame, view, points)
        phase = 4.0 * np.pi * px / camera.width_px
        waves = np.column_stack([np.sin(phase[:, 0]) * np.cos(phase[:, 1]), np.cos(phase[:, 0]) * np.sin(phase[:, 1])])
        return px + 2.0 * rms_px * waves

    return setup.corners_by(project)


def breathing(setup: Setup, dioptres: float, focal_mm: float = 3.67) -> Observations:
    """A lens that focuses anew in each frame: the picture grows by the focal length times the change of focus."""
    camera = setup.built.camera
    growth = focal_mm * 1e-3 * np.random.default_rng(1).normal(0.0, dioptres, len(setup.poses))
    centre = np.array([camera.cx_px, camera.cy_px])

    def project(frame: int, view: int, points: FloatArray) -> FloatArray:
        return centre + (1.0 + growth[frame]) * (setup.projected(frame, view, points) - centre)

    return setup.corners_by(project)


def moving_board(setup: Setup, speed_mm_s: float, readout_s: float = 0.03) -> Observations:
    """A board that moves while the rows are read, in another direction in each frame."""
    velocity = speed_mm_s * np.random.default_rng(1).normal(size=(len(setup.poses), 3)) / np.sqrt(3.0)
    rows = setup.built.camera.height_px

    def project(frame: int, view: int, points: FloatArray) -> FloatArray:
        late_s = readout_s * (setup.projected(frame, view, points)[:, 1:] / rows - 0.5)
        return setup.projected(frame, view, points + late_s * velocity[frame])

    return setup.corners_by(project)


def bowed_board(setup: Setup, sag_mm: float) -> Observations:
    """A board bent as a cylinder along its diagonal."""
    width, height = setup.request.target.size_mm

    def bent(points: FloatArray) -> FloatArray:
        along = (points[:, :2] / [width, height]).sum(axis=1) - 1.0
        return points + sag_mm * along[:, None] ** 2 * np.array([0.0, 0.0, 1.0])

    return setup.corners_by(setup.projected, bent)


def printed_board(setup: Setup, stretch: float, jitter_mm: float) -> Observations:
    """A print that is longer than wide by a factor, with corners off by an independent noise."""
    random = np.random.default_rng(1).normal(0.0, jitter_mm, (len(setup.corners_mm), 2))

    def bent(points: FloatArray) -> FloatArray:
        return points * [1.0, 1.0 + stretch, 1.0] + np.column_stack([random, np.zeros(len(random))])

    return setup.corners_by(setup.projected, bent)


def bent_mirrors(setup: Setup, sag_mm: float) -> Observations:
    """Mirrors with a spherical sag, each of its own, by rays traced to the bent surface."""
    settings = RenderSettings(finish=SurfaceFinish(sag_mm=sag_mm))
    finishes = draw_finishes(settings, len(setup.built.mirrors), np.random.default_rng(1))

    def project(frame: int, view: int, points: FloatArray) -> FloatArray:
        if view == DIRECT:
            return setup.projected(frame, view, points)
        return image_px(setup.built.camera, setup.built.mirrors[view], points, finishes[view])

    return setup.corners_by(project)


def warmer(setup: Setup, growth: float) -> Observations:
    """A holder that has grown about the camera since the calibration."""

    def project(frame: int, view: int, points: FloatArray) -> FloatArray:
        # The mirrors moved away from the pupil: as if the camera and the scene had shrunk before the same device.
        return setup.projected(frame, view, points if view == DIRECT else points / (1.0 + growth))

    return setup.corners_by(project)


def turned_camera(setup: Setup, degrees: float) -> Observations:
    """A camera that has turned in its clip since the calibration, about its horizontal axis."""
    angle = np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])

    def project(frame: int, view: int, points: FloatArray) -> FloatArray:
        seen = points if view == DIRECT else setup.built.mirrors[view].reflect(points)
        return setup.built.camera.project(seen @ turn.T)

    return setup.corners_by(project)
