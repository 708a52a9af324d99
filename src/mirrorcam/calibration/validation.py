"""Blind calibration of a rendered set, then the comparison with its ground truth.

`calibrate_set` reads only what a real user has: frames, base frames, nominal layout and board. `validate` calls it
before it reads the `truth` folder.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.calibration.calibration_files import write_calibration
from mirrorcam.calibration.decoded_corners import DecodedCorners, decoded_corners
from mirrorcam.calibration.error_bounds import LIMITED, bounded, corner_bounds, mirror_bounds
from mirrorcam.core.arguments import AnyPath, check_callable, path_of
from mirrorcam.core.disk.files import LARGEST_FILE_BYTES, inside, read_model, write_metrics
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import FloatArray, Matrix4, Metric, Value
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.parameterisation import rotated_like
from mirrorcam.optics.geometry.boards import load_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.sets.dataset import Dataset, true_layout

TOO_FEW_FRAMES = "too few frames to measure it, expected 6 or more"


class _Poses(Value):
    """The content of `truth/poses.json`: rig_from_board of each frame and each base frame."""

    frames: tuple[Matrix4, ...]
    base: tuple[Matrix4, ...]


@dataclass(frozen=True)
class Validation:
    """A blind calibration, and its figures relative to the truth; it passes if all are within their limits."""

    calibration: Calibration
    metrics: dict[str, Metric]

    @property
    def passed(self) -> bool:
        return all(metric.passed for metric in self.metrics.values())


def calibrate_set(folder: Path, *, progress: Progress = no_progress) -> Calibration:
    """Calibrate a rendered set from its frames, base frames, nominal layout and board; `progress` as in `calibrate`."""
    dataset = Dataset.load(folder)
    layout, board = Layout.load(folder / "layout.json"), load_board(folder / "board.toml")

    frames = [inside(folder, name) for name in dataset.frame_names]
    base_frames = [inside(folder, name) for name in dataset.base_names]
    names = dataset.frame_names, dataset.base_names
    return calibrate(frames, base_frames, layout, board, workers=cores(), names=names, progress=progress)


def validate(folder: AnyPath, *, progress: Progress = no_progress) -> Validation:
    """Calibrate and decode a rendered set from its pictures alone, then compare the result with the set's truth.

    With two mirrors, their common rotation about the line where their planes meet, which no picture shows, is removed.

    Parameters
    ----------
    folder
        Folder of a set made by `render_set`.
    progress
        Called with the number of steps done and the number expected: those of `calibrate`, and one per picture via the
        mirrors that is decoded.

    Returns
    -------
    Validation
        The calibration, and its figures relative to the truth.

    Raises
    ------
    InputError
        If the set lacks a file, or its pictures do not suffice.
    """
    folder = path_of("folder", folder)
    check_callable("progress", progress)
    dataset, board = Dataset.load(folder), load_board(folder / "board.toml")
    total = 0

    def advance(done: int, expected: int) -> None:
        nonlocal total
        total = expected + dataset.frames
        progress(done, total)

    calibration = calibrate_set(folder, progress=advance)
    truth = true_layout(folder)
    poses = read_model(_Poses, folder / "truth" / "poses.json", LARGEST_FILE_BYTES).frames
    layout, pair_metrics = calibration.layout, {}
    if len(layout.mirrors) == 2:
        layout, angle = rotated_like(layout, truth)
        pair_metrics["pair_turn_deg"] = Metric(value=abs(np.degrees(angle)), unit="deg")
    metrics = mirror_errors(layout, truth) | pair_metrics
    metrics |= {name: figure for name, figure in calibration.metrics.items() if not name.startswith("mirror_")}
    if len(poses) != dataset.frames:
        raise InputError(f"{folder}: {len(poses)} true poses for {dataset.frames} frames, expected one for each")
    decoder = Decoder(layout)
    parts = []
    for done, (name, rig_from_board) in enumerate(zip(dataset.frame_names, poses, strict=True), start=1):
        light_field = decoder.decode(read_image(inside(folder, name)))
        parts.append(decoded_corners(light_field, layout, truth, board, rig_from_board))
        progress(total - dataset.frames + done, total)
    decoded = DecodedCorners.join(parts)
    metrics |= decoded_metrics(decoded.distances_px())
    for name in set(LIMITED) - metrics.keys():
        metrics[name] = Metric(value=np.nan, unit=name.rpartition("_")[2], reason=TOO_FEW_FRAMES)
    metrics = bounded(metrics, mirror_bounds(calibration.layout) | corner_bounds(calibration, decoded))
    limited = sorted(metrics, key=lambda name: [*LIMITED, name].index(name))
    return Validation(calibration, {name: metrics[name] for name in limited})


def decoded_metrics(distance_px: FloatArray) -> dict[str, Metric]:
    """Figures of the distances (n,) of decoded corners from their true positions; unknown if no corner was found."""
    reason, has_corners = ("", True) if len(distance_px) else ("no corner was found in any decoded view", False)
    rms = np.sqrt(np.mean(distance_px**2)) if has_corners else np.nan
    p95 = np.percentile(distance_px, 95) if has_corners else np.nan
    return {
        "decoded_corner_rms_px": Metric(value=float(rms), unit="px", reason=reason),
        "decoded_corner_p95_px": Metric(value=float(p95), unit="px", reason=reason),
        "decoded_corners": Metric(value=len(distance_px), unit="1"),
    }


def write_validation(validation: Validation, folder: Path, *, command: str) -> None:
    """Write the files of the calibration into a folder, and all figures of the validation as its metrics.json."""
    write_calibration(validation.calibration, folder, command=command)
    write_metrics(folder / "metrics.json", validation.metrics)


def mirror_errors(layout: Layout, truth: Layout) -> dict[str, Metric]:
    """Angles between calibrated and true normals, and errors of distance: worst, and rms over the mirrors.

    `normal_error_between_mirrors_max_deg` excludes the mean rotation of all normals.
    """
    if len(layout.mirrors) != len(truth.mirrors):
        raise InputError(f"{len(layout.mirrors)} mirrors calibrated, truth has {len(truth.mirrors)}")
    normals = np.array([mirror.normal_in_rig for mirror in layout.mirrors])
    true_normals = np.array([mirror.normal_in_rig for mirror in truth.mirrors])
    tilts = np.cross(true_normals, normals)  # for small angles its length is the angle
    angles = np.degrees(np.arcsin(np.linalg.norm(tilts, axis=1)))
    relative = np.degrees(np.linalg.norm(tilts - tilts.mean(axis=0), axis=1))
    distances = np.array([m.distance_mm for m in layout.mirrors]) - np.array([m.distance_mm for m in truth.mirrors])
    figures = {
        "normal_error_max_deg": Metric(value=angles.max(), unit="deg"),
        "normal_error_rms_deg": Metric(value=np.sqrt(np.mean(angles**2)), unit="deg"),
        "normal_error_between_mirrors_max_deg": Metric(value=relative.max(), unit="deg"),
        "distance_error_max_mm": Metric(value=np.abs(distances).max(), unit="mm"),
        "distance_error_rms_mm": Metric(value=np.sqrt(np.mean(distances**2)), unit="mm"),
        "focal_error_px": Metric(value=abs(layout.camera.fx_px - truth.camera.fx_px), unit="px"),
    }
    second_surface = [(m, t) for m, t in zip(layout.mirrors, truth.mirrors, strict=True) if t.is_second_surface]
    if second_surface:
        thickness = [mirror.thickness_mm - true.thickness_mm for mirror, true in second_surface]
        figures["sheet_error_mm"] = Metric(value=np.abs(thickness).max(), unit="mm")
    return figures
