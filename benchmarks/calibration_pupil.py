"""Calibration with a lens that is no pinhole: `python -m benchmarks.calibration_pupil SET [SET ...]`.

Sets come from `mirrorcam render LAYOUT --sensor c920 --seed N`, of either renderer. Each is calibrated from its frames,
nominal layout and board alone before its truth is read. Prints

- corners found minus true ones, along the normal of the nearest edge of the sub-image, inwards, by their distance from
  it, and along the line from the principal point: of the corners that the calibration uses;
- errors of normals, of frames left out, and of all parameters of camera and mirrors in terms of their covariance (NEES
  per parameter: 1 where it is right);
- the diameter of the pupil and the distance in focus, and how many standard deviations they are off. For several sets,
  the root mean square of these.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from benchmarks.records import Table, add_json_option, table, write_record
from mirrorcam.calibration.validation import mirror_errors, validate
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.settings import SENSORS

BINS_PX = (0.0, 9.0, 12.0, 15.0, 20.0, 30.0, 60.0, 1000.0)
FAR_PX = 1.0
"""Beyond this an error is that of a false corner."""


@dataclass(frozen=True)
class Corners:
    """Corners (n): distance from the nearest edge, and the error along its normal, inwards, px.

    `outwards` and its standard deviation are the error away from the principal point, px, where tan of the field angle
    is 1, if it is proportional to that.
    """

    distance_px: FloatArray
    off_px: FloatArray
    outwards: tuple[float, float]

    def mean_between(self, low: float, high: float) -> str:
        """The mean error of corners so far from an edge, with its standard deviation."""
        off = self.off_px[(self.distance_px >= low) & (self.distance_px < high) & (np.abs(self.off_px) < FAR_PX)]
        return f"{off.mean():.4f} ± {off.std() / np.sqrt(len(off)):.4f} px" if len(off) else "none used"

    def told(self) -> None:
        """Print the errors by distance."""
        for low, high in pairwise(BINS_PX):
            off = self.off_px[(self.distance_px >= low) & (self.distance_px < high) & (np.abs(self.off_px) < FAR_PX)]
            if len(off):
                spread = float(off.std()) / np.sqrt(len(off))
                rms = float(np.sqrt(np.mean(off**2)))
                where = f"{low:g} to {high:g} px from an edge"
                print(f"    {where:28} {len(off):6d} corners, mean {off.mean():+.4f} +- {spread:.4f}, rms {rms:.4f} px")
        print(f"    away from the middle, at tan 1: {self.outwards[0]:+.5f} +- {self.outwards[1]:.5f} px")


def near_edges(calibration: Calibration, true: Layout, truth_px: FloatArray, numbers: list[int]) -> Corners:
    """The corners that a calibration used, against true pixels (frames, mirrors, corners, 2)."""
    seen = calibration.observations.where(calibration.inliers & (calibration.observations.view != DIRECT))
    at = truth_px[np.array(numbers)[seen.frame], seen.view, seen.corner]
    distance, off = np.full(len(seen), np.nan), np.full(len(seen), np.nan)
    for index in range(len(true.mirrors)):
        rows = np.flatnonzero(seen.view == index)
        edge = shapely.Polygon(true.outline_px(index)).exterior
        points = shapely.points(at[rows])
        foot = shapely.get_coordinates(shapely.line_interpolate_point(edge, shapely.line_locate_point(edge, points)))
        distance[rows] = shapely.distance(edge, points)
        inwards = (at[rows] - foot) / np.maximum(distance[rows], 1e-9)[:, None]
        off[rows] = ((seen.pixels[rows] - at[rows]) * inwards).sum(axis=1)
    camera = true.camera
    tangent = (at - [camera.cx_px, camera.cy_px]) / camera.fx_px
    error = np.where(np.abs(off)[:, None] < FAR_PX, seen.pixels - at, 0.0)
    square = float(np.sum(tangent**2))
    outwards = float(np.sum(error * tangent)) / square, float(np.sqrt(np.mean(error**2) / square))
    return Corners(distance, off, outwards)


def nees(calibration: Calibration, true: Layout) -> float:
    """Squared errors of intrinsics and virtual centres by their covariance, per parameter."""
    known = calibration.layout.uncertainty
    if known is None:
        return float("nan")

    def values(layout: Layout) -> dict[str, float]:
        centres = {
            f"mirror {index} {axis}_mm": float(value)
            for index, centre in enumerate(layout.virtual_centres_in_rig_mm)
            for axis, value in zip("xyz", centre, strict=True)
        }
        return dict(zip(layout.camera.intrinsic_names, layout.camera.intrinsics.tolist(), strict=True)) | centres

    found, expected = values(calibration.layout), values(true)
    places = [place for place, name in enumerate(known.parameters) if name in found]
    off = np.array([found[known.parameters[place]] - expected[known.parameters[place]] for place in places])
    return float(off @ np.linalg.solve(known.covariance[np.ix_(places, places)], off)) / len(off)


@dataclass(frozen=True)
class Pupil:
    """Errors of the diameter and of 1 / focus in standard deviations, NaN where they were not found; and as texts."""

    errors: tuple[float, float]
    diameter: str
    nearness: str


def pupil_of(calibration: Calibration, true: Layout) -> Pupil:
    """Diameter and focus against the truth; prints them."""
    figures = {name: metric.value for name, metric in calibration.metrics.items()}
    camera = true.camera
    if "aperture_mm" not in figures:
        print("    pupil not seen")
        return Pupil((float("nan"), float("nan")), "not seen", "not seen")
    width, sigma = figures["aperture_mm"], figures["aperture_sigma_mm"]
    off = (width - camera.aperture_mm) / sigma
    print(f"    pupil {width:.3f} +- {sigma:.3f} mm, true {camera.aperture_mm:g}: {off:+.1f} sigma")
    if "focus_mm" not in figures:
        print("    focus not seen")
        return Pupil((off, float("nan")), f"{width:.2f} ± {sigma:.2f} of {camera.aperture_mm:g}", "not seen")
    nearness, nearness_sigma = 1e3 / figures["focus_mm"], figures["focus_sigma_per_m"]
    off_focus = (nearness - 1e3 / camera.focus_mm) / nearness_sigma
    print(
        f"    focus {figures['focus_mm']:.0f} mm ({nearness:.2f} +- {nearness_sigma:.2f} 1/m), "
        f"true {camera.focus_mm:g}: {off_focus:+.1f} sigma"
    )
    return Pupil(
        (off, off_focus),
        f"{width:.2f} ± {sigma:.2f} of {camera.aperture_mm:g}",
        f"{nearness:.2f} ± {nearness_sigma:.2f} of {1e3 / camera.focus_mm:.2f}",
    )


TITLES = (
    "mean along the edge's normal, 15 to 20 px from it",
    "the same, 20 to 30 px",
    "worst normal",
    "held-out corners, RMS, worse axis",
    "decoded corners, RMS",
    "NEES per parameter of camera and mirrors",
    "pupil, mm",
    "one over the distance in focus, 1/m",
)


@dataclass(frozen=True)
class Report:
    """A set: its sensor and renderer, its cells of the table, and errors of its pupil."""

    title: str
    cells: tuple[str, ...]
    errors: tuple[float, float]


def tabled(reports: list[Report]) -> Table:
    """A column for each sensor and renderer, with the figures of all its sets."""
    columns: dict[str, list[Report]] = {}
    for each in reports:
        columns.setdefault(each.title, []).append(each)
    heads = [f"{title}{f', {len(some)} sets' if len(some) > 1 else ''}" for title, some in columns.items()]
    rows = [
        (name, *(", ".join(each.cells[place] for each in some) for some in columns.values()))
        for place, name in enumerate(TITLES)
    ]
    return table(("", *heads), rows)


def report(folder: Path) -> Report:
    """Calibrate a set, print its figures and return those of the table."""
    dataset = Dataset.load(folder)
    validation = validate(folder)
    calibration = validation.calibration
    true = Layout.load(folder / "truth" / "layout.json")
    true = true.replaced(camera=true.camera.with_pupil(dataset.settings.sensor.pupil))
    with np.load(folder / "truth" / "corners.npz") as truth:
        truth_px = truth["frames_px"]
    print(f"{folder.name}: {dataset.settings.renderer}, pupil {true.camera.aperture_mm:g} mm")
    unused = {
        int(note.split()[1].rstrip(":"))
        for note in calibration.notes
        if note.startswith("frame ") and note.endswith("not used")
    }
    corners_seen = near_edges(calibration, true, truth_px, [n for n in range(dataset.frames) if n not in unused])
    corners_seen.told()
    errors = mirror_errors(calibration.layout, true)
    held_out = max(calibration.metrics[f"held_out_rms_{axis}_px"].value for axis in "xy")
    outliers, corners = int((~calibration.inliers).sum()), len(calibration.inliers)
    print(
        f"    normals {errors['normal_error_max_deg'].value:.5f} deg, distances "
        f"{errors['distance_error_max_mm'].value:.4f} mm, held out {held_out:.4f} px, NEES per parameter "
        f"{nees(calibration, true):.2f}, {outliers} of {corners} corners outliers"
    )
    for alarm in calibration.diagnostics.alarms if calibration.diagnostics is not None else ():
        print(f"    ALARM: {alarm}")
    pupil = pupil_of(calibration, true)
    cells = (
        corners_seen.mean_between(15.0, 20.0),
        corners_seen.mean_between(20.0, 30.0),
        f"{errors['normal_error_max_deg'].value:.4f}°",
        f"{held_out:.3f} px",
        f"{validation.metrics['decoded_corner_rms_px'].value:.3f} px",
        f"{nees(calibration, true):.1f}",
        pupil.diameter,
        pupil.nearness,
    )
    sensor = next((name for name, each in SENSORS.items() if each == dataset.settings.sensor), "another sensor")
    renderer = {"mitsuba": "reference"}.get(dataset.settings.renderer, dataset.settings.renderer)
    return Report(f"`{sensor}`, {renderer}", cells, pupil.errors)


def main(folders: list[Path], json: Path | None) -> None:
    reports = [report(folder) for folder in folders]
    write_record(json, "calibration_pupil", table=tabled(reports))
    errors = np.array([each.errors for each in reports])
    if len(folders) > 1:
        rms = np.sqrt(np.nanmean(errors**2, axis=0))
        print(f"all: errors of pupil and focus, rms {rms[0]:.2f} and {rms[1]:.2f} sigma")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", type=Path, metavar="SET")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.sets, options.json)
