"""Calibrate from files of labels, and write the result as files."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from math import radians, tan
from pathlib import Path

import numpy as np

from mirrorcam.calibration.calibration_files import residual_figure
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.calibration.label_page import label_report
from mirrorcam.core.disk.files import atomic, write_metrics, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import is_picture, pictures_in, read_image
from mirrorcam.core.video.video_files import open_video
from mirrorcam.optics.calibration.labels.known_scale import KnownLength
from mirrorcam.optics.calibration.labels.label_calibration import data_sheet_prior, unknown_camera
from mirrorcam.optics.calibration.labels.label_files import read_labels
from mirrorcam.optics.calibration.labels.label_result import LabelCalibration, calibrate_labels
from mirrorcam.optics.calibration.labels.point_adjustment import CameraPrior
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import camera_names, read_camera
from mirrorcam.optics.geometry.layout import Layout, Uncertainty

FILES = ("layout.json", "metrics.json", "report.html", "residuals.png", "labels.csv", "points.csv")
"""Names of the files that a calibration from labels writes."""
LIBRARY_FOCAL_SIGMA = 0.03
"""Relative standard deviation of the focal length of a camera of the library, whose figures its maker published."""


def calibrate_label_files(
    pictures: Sequence[Path], request: CalibrationRequest, *, on_note: Callable[[str], None]
) -> LabelCalibration:
    """Calibrate from a request's files of labels; a picture or video among `pictures` gives the size of frames.

    Raises InputError if a file cannot be read, or the labels do not suffice.
    """
    table = read_labels(request.labels, request.views)
    known = None
    if request.known_length is not None:
        first, second, length = request.known_length
        known = KnownLength(first, second, length)
    return calibrate_labels(table, _camera_prior(pictures, request, on_note), known)


def _camera_prior(pictures: Sequence[Path], request: CalibrationRequest, on_note: Callable[[str], None]) -> CameraPrior:
    if request.camera is not None:
        return _given_camera(request.camera)
    if not pictures:
        raise InputError("expected --camera FILE, or a picture or video that shows the size of the frames")
    width, height = _size(pictures, on_note)
    if request.field_of_view is None:
        on_note("nothing is known of the camera: its focal length is fitted; --camera or --field-of-view state it")
        return unknown_camera(width, height)
    view_deg, sigma_deg = request.field_of_view
    half = radians(view_deg) / 2.0
    focal_px = width / 2.0 / tan(half)
    # f = w / (2 tan(a / 2)), so df / da = -w / (4 sin(a / 2)^2).
    focal_sigma_px = width / 4.0 / np.sin(half) ** 2 * radians(sigma_deg)
    return data_sheet_prior(width, height, focal_px, focal_sigma_px)


def _size(pictures: Sequence[Path], on_note: Callable[[str], None]) -> tuple[int, int]:
    path = pictures_in(pictures, on_note)[0]
    if not is_picture(path):
        video = open_video(path, on_note)
        return video.width_px, video.height_px
    height, width = read_image(path, grey=True).shape
    return width, height


def _given_camera(name: str) -> CameraPrior:
    """A camera by file or by name: calibrated ones are held or have their covariance, published ones a wide prior."""
    path = Path(name)
    if name in camera_names() or path.suffix.lower() == ".toml":
        camera = read_camera(name)
        prior = data_sheet_prior(camera.width_px, camera.height_px, camera.fx_px, LIBRARY_FOCAL_SIGMA * camera.fx_px)
        return CameraPrior(camera.replaced(distortion=prior.camera.distortion), prior.covariance)
    if path.suffix.lower() == ".json" and (layout := _layout(path)) is not None:
        return _with_covariance(layout.camera, layout.uncertainty)
    rig = read_rig(path)
    if len(rig.cameras) != 1 or not isinstance(rig.cameras[0].lens, Camera):
        raise InputError(f"{path}: {len(rig.cameras)} cameras, expected the calibration of one pinhole camera")
    if rig.cameras[0].size_px is None:
        raise InputError(f"{path}: states no picture size, expected image_width and image_height")
    return CameraPrior.known(rig.cameras[0].lens)


def _layout(path: Path) -> Layout | None:
    """The layout in a JSON file; None if it holds something else."""
    try:
        return Layout.load(path)
    except InputError:
        return None


def _with_covariance(camera: Camera, uncertainty: Uncertainty | None) -> CameraPrior:
    prior = CameraPrior.known(camera)
    if uncertainty is None:
        return prior
    names = camera.intrinsic_names
    known = [(names.index(name), row) for row, name in enumerate(uncertainty.parameters) if name in names]
    if not known:
        return prior
    covariance = prior.covariance.copy()
    columns, rows = (list(indices) for indices in zip(*known, strict=True))
    covariance[np.ix_(columns, columns)] = uncertainty.covariance[np.ix_(rows, rows)]
    return CameraPrior(camera, covariance)


def write_label_calibration(result: LabelCalibration, folder: Path, *, command: str) -> None:
    """Write layout.json, metrics.json, report.html, residuals.png, labels.csv and points.csv, each atomically."""
    result.layout.save(folder / "layout.json")
    write_metrics(folder / "metrics.json", result.calibration.metrics)
    residual_figure(result.calibration, folder / "residuals.png")
    write_text(folder / "report.html", label_report(result, command=command))
    _write_table(folder / "labels.csv", _label_rows(result))
    _write_table(folder / "points.csv", _point_rows(result))


def _write_table(path: Path, rows: Iterator[Sequence[object]]) -> None:
    with atomic(path) as temporary, temporary.open("w", encoding="utf-8", errors="replace", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def _label_rows(result: LabelCalibration) -> Iterator[Sequence[object]]:
    """All labels of points in two views or more; `read_labels` reads the table again."""
    yield ("frame", "view", "label", "x_px", "y_px", "used", "error_px", "remark")
    remarks = {(item.frame, item.view, item.label): item.remark for item in result.rejected}
    calibration, table = result.calibration, result.table
    rows = calibration.observations
    errors = np.linalg.norm(calibration.residuals_px, axis=1)
    columns = (rows.frame, rows.view, rows.corner, rows.pixels, calibration.inliers, errors)
    for frame, view, label, (x, y), used, error in zip(*(column.tolist() for column in columns), strict=True):
        names = (table.frames[frame], table.views[view - DIRECT], table.labels[label])
        error_text = f"{error:.3f}" if np.isfinite(error) else ""
        yield (*names, f"{x:.4f}", f"{y:.4f}", int(used), error_text, remarks.get((frame, view, label), ""))


def _point_rows(result: LabelCalibration) -> Iterator[Sequence[object]]:
    """Points with the upper triangle of their covariances."""
    axes = [a + b for i, a in enumerate("xyz") for b in "xyz"[i:]]
    yield ("frame", "label", "x_mm", "y_mm", "z_mm", *(f"covariance_{pair}_mm2" for pair in axes))
    points, table = result.points, result.table
    upper = np.triu_indices(3)
    for number, (frame, label) in enumerate(zip(points.frame.tolist(), points.label.tolist(), strict=True)):
        position = (f"{value:.4f}" for value in points.positions[number])
        yield (
            table.frames[frame],
            table.labels[label],
            *position,
            *(f"{value:.6g}" for value in points.covariances[number][upper]),
        )
