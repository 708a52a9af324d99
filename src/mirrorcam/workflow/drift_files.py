"""A drift test from files, and its result as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.drift.drift import Drift
from mirrorcam.optics.drift.resolved_layout import resolved_layout
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.workflow.drift_check import DRIFT, drift_of_files, tells_drift, write_drift
from mirrorcam.workflow.frame_checks import check_frames

FILES = (DRIFT, "layout.json")


def find_drift_files(paths: Sequence[Path], layout: Layout, layout_path: Path) -> Drift:
    """What pictures and videos of one recording tell of the mirrors of a calibrated layout.

    Raises InputError for a layout that states no measured mirrors, and for files that are not of its camera.
    """
    if not tells_drift(layout):
        what = "is a nominal layout" if layout.kind == "nominal" else "has one mirror"
        raise InputError(f"{layout_path}: {what}, expected a calibrated one of two mirrors or more")
    check_frames(paths, layout, layout_path)
    return drift_of_files(layout, paths)


def write_drift_files(layout: Layout, drift: Drift, sources: Sequence[str], folder: Path) -> None:
    """Write drift.json and, where a mirror moved, the re-solved layout.json."""
    write_drift(layout, drift, folder / DRIFT)
    if drift.moved:
        more = f" and {len(sources) - 1} more" if len(sources) > 1 else ""
        resolved_layout(layout, drift, f"a scene in {sources[0][:80]}{more}").save(folder / "layout.json")
