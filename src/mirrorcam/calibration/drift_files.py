"""A drift test from files, and its result as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mirrorcam.calibration.drift_check import DRIFT, drift_metrics, drift_of_files
from mirrorcam.calibration.stiffness import MountTilt
from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import InputError, Metric
from mirrorcam.optics.drift.drift import LEAST_MIRRORS, Drift, resolved_layout, shows_drift
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.frame_checks import check_frames

FILES = (DRIFT, "layout.json")


def find_drift_files(
    paths: Sequence[Path], layout: Layout, layout_path: Path, tell: Callable[[str], None] = lambda line: None
) -> Drift:
    """What pictures and videos of one recording tell of the mirrors of a calibrated layout.

    `tell` is called with what the user should know of a video, and of pictures of 16 bits. Raises InputError for a
    layout that states no measured mirrors, and for files that are not of its camera.
    """
    if not shows_drift(layout):
        nominal = layout.kind == "nominal"
        what = "is a nominal layout" if nominal else f"has {count_text(len(layout.mirrors), 'mirror')}"
        raise InputError(f"{layout_path}: {what}, expected a calibrated one of {LEAST_MIRRORS} mirrors or more")
    check_frames(paths, layout, layout_path, tell)
    return drift_of_files(layout, paths, tell)


def write_drift_files(layout: Layout, drift: Drift, tilt: MountTilt, sources: Sequence[str], folder: Path) -> None:
    """Write drift.json, how far the mount bends among it, and, where a mirror moved, the re-solved layout.json."""
    bending = {"mount_tilt_deg": Metric(value=tilt.deg, unit="deg")}
    write_metrics(folder / DRIFT, drift_metrics(layout, drift) | bending)
    if drift.moved:
        more = f" and {len(sources) - 1} more" if len(sources) > 1 else ""
        resolved_layout(layout, drift, f"a scene in {sources[0][:80]}{more}").save(folder / "layout.json")
