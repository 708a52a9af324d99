"""Detect mirrors that moved since the calibration from a recording; report the result as text and files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.console.reporter import Reporter
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_json, write_metrics
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.pictures import is_picture, read_image
from mirrorcam.core.values import Metric
from mirrorcam.core.video.frames import SpreadFrames, WatchedSource
from mirrorcam.core.video.video_files import open_video
from mirrorcam.optics.drift.drift import (
    MIN_MIRRORS,
    TARGET_DEG,
    Drift,
    can_test_drift,
    drift_corrected_layout,
    find_drift,
)
from mirrorcam.optics.drift.matched_points import MatchedPoints, PointMatcher
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.frame_checks import check_frames

DRIFT = "drift.json"
TILT = "mount.tilt_deg"
WARNING_SIGMAS = 3.5
"""Number of standard deviations by which a common rotation must exceed bending for a warning."""
FILES = (DRIFT, "layout.json")


def drift_of(layout: Layout, frames: Sequence[Any], reference_depth_mm: float | None = None) -> Drift:
    """Test the mirrors in frames of one recording; raises InputError if the views do not overlap."""
    matcher = PointMatcher(layout, reference_depth_mm)
    return find_drift(layout, MatchedPoints.joined([matcher.match(frame) for frame in frames]))


@dataclass(frozen=True)
class DriftReporter:
    """Reports whether mirrors moved, for each decoded recording, in a line and in a file next to it.

    `reference_depth_mm` is the decoder's; the suggested command uses `layout_path`.
    """

    layout: Layout
    layout_path: Path
    reference_depth_mm: float | None
    output: OutputFolder
    reporter: Reporter
    file: str = DRIFT

    def report(self, frames: Sequence[Any], name: str, sources: str) -> None:
        """Test frames of a recording; `name` is the output file, `sources` are the arguments for `mirrorcam drift`."""
        if not frames:
            return
        try:
            drift = drift_of(self.layout, frames, self.reference_depth_mm)
        except InputError as error:  # the decoded views lack the field that the test needs
            self.reporter.note("decode", f"cannot check whether mirrors have moved: {error}")
            return
        with self.output.staged(complete=False) as folder:
            write_drift(self.layout, drift, folder / name)
        line = drift_line(self.layout, drift)
        if drift.moved:
            line += f"; mirrorcam drift {sources} --layout {self.layout_path} re-solves what moved"
        self.reporter.note("decode", line)


def drift_check(
    layout: Layout, layout_path: Path, reference_depth_mm: float | None, output: OutputFolder, reporter: Reporter
) -> DriftReporter | None:
    """The check of recordings for mirrors that moved; None if the layout does not permit one."""
    if can_test_drift(layout):
        return DriftReporter(layout, layout_path, reference_depth_mm, output, reporter)
    if layout.kind != "nominal":
        count = count_text(len(layout.mirrors), "mirror")
        reporter.note("decode", f"not tested whether {count} moved: the test needs {MIN_MIRRORS} or more")
    return None


def drift_line(layout: Layout, drift: Drift) -> str:
    """The result for a recording, in one line."""
    names = layout.mirror_names
    if drift.moved:
        moves = [f"{names[m.index]} by {m.angle_deg:.3f}° ± {m.rotation_sigma_deg:.3f}°" for m in drift.moved]
        subject = "a mirror has" if len(moves) == 1 else f"{len(moves)} mirrors have"
        return f"{subject} moved since the calibration: {', '.join(moves[:4])}{', ...' if len(moves) > 4 else ''}"
    if drift.undetermined and drift.mismatched:
        return (
            "the pictures have detail, but do not fit this layout: corners are not found in other views, or where no "
            "motion of mirrors explains them; is it another device, or a repeating pattern?"
        )
    if drift.undetermined:
        worst = max(drift.undetermined, key=lambda mirror: mirror.detectable_deg)
        count = len(drift.undetermined)
        subject_text = f"{count} of {len(names)} mirrors" if count > 1 else f"mirror {names[worst.index]}"
        detectable = f"rotations of {worst.detectable_deg:.2g}° or more" if worst.detectable_deg < 10.0 else "nothing"
        return (
            f"not enough texture to determine whether {subject_text} moved by {TARGET_DEG:g}°: "
            f"{count_text(worst.points, 'point')} matched in mirror {names[worst.index]} show {detectable}; expected a "
            f"scene with detail all over, in more frames"
        )
    largest = max(drift.mirrors, key=lambda mirror: mirror.detectable_deg)
    return (
        f"no mirror has moved: rotations of {largest.detectable_deg:.3f}° or more would show in "
        f"{count_text(drift.points, 'point')} of {count_text(drift.frames, 'frame')}"
    )


def drift_metrics(layout: Layout, drift: Drift) -> dict[str, Metric]:
    """The figures of a drift test; `statistic` is relative to the threshold of an alarm."""
    figures = {
        "mirrors_moved": Metric(value=len(drift.moved), unit="", limit=0),
        "mirrors_not_told": Metric(value=len(drift.undetermined), unit="", limit=0),
        "frames": Metric(value=drift.frames, unit=""),
        "points": Metric(value=drift.points, unit=""),
        "match_sigma_px": Metric(value=drift.sigma_px, unit="px"),
    }
    for axis, turn, sigma in zip("xyz", drift.common_rotation_deg, drift.common_rotation_sigma_deg, strict=True):
        figures[f"common_turn_{axis}_deg"] = Metric(value=turn, unit="deg")
        figures[f"common_turn_{axis}_sigma_deg"] = Metric(value=sigma, unit="deg")
    for mirror in drift.mirrors:
        row, column = divmod(mirror.index, layout.cols)
        values = {
            "statistic": Metric(value=mirror.statistic, unit="1", limit=1.0),
            "turn_deg": Metric(value=mirror.angle_deg, unit="deg"),
            "turn_sigma_deg": Metric(value=mirror.rotation_sigma_deg, unit="deg"),
            "shift_mm": Metric(value=mirror.shift_mm, unit="mm"),
            "tells_deg": Metric(value=mirror.detectable_deg, unit="deg", limit=TARGET_DEG),
            "points": Metric(value=mirror.points, unit=""),
        }
        figures |= {f"view_{row}_{column}_{name}": value for name, value in values.items()}
    return figures


def write_drift(layout: Layout, drift: Drift, path: Path) -> None:
    """Write the figures as JSON, atomically."""
    write_metrics(path, drift_metrics(layout, drift))


@dataclass(frozen=True)
class MountTilt:
    """Maximum angle by which gravity, bending the mount, rotates all mirrors together; and its source."""

    deg: float
    source: str


def mount_tilt(checks: Path | None) -> MountTilt:
    """Read the tilt of the mount from a device's `checks.json`; if None, return the limit that mounts are designed for.

    Raises InputError if the file lacks it.
    """
    if checks is None:
        return MountTilt(HARDWARE.mount.tilt_deg, "the limit that mounts are designed for")
    figures = read_json(checks, LARGEST_LAYOUT_BYTES)
    entry = figures.get(TILT) if isinstance(figures, dict) else None
    value = entry.get("value") if isinstance(entry, dict) else None
    if not isinstance(value, int | float) or not 0.0 <= value <= 180.0:
        raise InputError(f"{checks}: no angle {TILT}, expected checks.json of mirrorcam cad")
    return MountTilt(float(value), str(checks))


def bending_line(drift: Drift, tilt: MountTilt) -> str:
    """State whether bending of the mount explains the common rotation of all mirrors."""
    bound = f"gravity bends the mount by {tilt.deg:.2g}° at most ({tilt.source}), which rotates all mirrors equally"
    turn, sigma = drift.common_rotation_deg, drift.common_rotation_sigma_deg
    exceeds = np.abs(turn) - WARNING_SIGMAS * sigma > tilt.deg
    if exceeds.any():
        axis = int(np.argmax(np.abs(turn) / sigma))
        return (
            f"all mirrors together have rotated by {abs(turn[axis]):.2g}° ± {sigma[axis]:.2g}° about {'xyz'[axis]} of "
            f"the rig: more than bending, has the camera slipped? {bound}"
        )
    return f"{bound}; bending does not rotate one mirror relative to the others"


def find_drift_files(
    paths: Sequence[Path], layout: Layout, layout_path: Path, on_note: Callable[[str], None] = lambda line: None
) -> Drift:
    """Test the mirrors of a calibrated layout with pictures and videos of one recording.

    A few evenly spread frames are used. `on_note` receives remarks on videos and on pictures of 16 bits. Raises
    InputError for a layout that is not calibrated, and for files that are unreadable, damaged or not of the size of its
    camera's pictures.
    """
    if not can_test_drift(layout):
        nominal = layout.kind == "nominal"
        state = "is a nominal layout" if nominal else f"has {count_text(len(layout.mirrors), 'mirror')}"
        raise InputError(f"{layout_path}: {state}, expected a calibrated layout of {MIN_MIRRORS} mirrors or more")
    check_frames(paths, layout, layout_path, on_note)
    sample = SpreadFrames()
    for path in paths:
        if is_picture(path):
            sample.add(read_image(path))
        else:
            for item in WatchedSource(open_video(path, on_note), sample).frames():
                del item
    if not sample.frames:
        raise InputError(f"{paths[0]}: no frame could be decoded, expected at least one")
    return drift_of(layout, sample.frames)


def write_drift_files(layout: Layout, drift: Drift, tilt: MountTilt, sources: Sequence[str], folder: Path) -> None:
    """Write drift.json, with the bending of the mount, and, if a mirror moved, the re-solved layout.json."""
    bending = {"mount_tilt_deg": Metric(value=tilt.deg, unit="deg")}
    write_metrics(folder / DRIFT, drift_metrics(layout, drift) | bending)
    if drift.moved:
        more = f" and {len(sources) - 1} more" if len(sources) > 1 else ""
        drift_corrected_layout(layout, drift, f"a scene in {sources[0][:80]}{more}").save(folder / "layout.json")
