"""Files of a part for a CAD program and for a printer: the same part gives the same bytes."""

from __future__ import annotations

from pathlib import Path

from build123d import Part, export_step, export_stl

from optics.files import atomic

# A STEP file names a time; a fixed one keeps the bytes the same from day to day.
STEP_TIME = "2000-01-01T00:00:00"
STL_TOLERANCE_MM = 0.02
STL_ANGLE_RAD = 0.2


def write_step(path: Path, part: Part) -> None:
    """Write a part as STEP, in mm, named by its label."""
    with atomic(path) as temporary:
        # Curves in the parameters of flat faces say nothing that the faces do not, and double the file.
        if not export_step(part, temporary, write_pcurves=False, timestamp=STEP_TIME):
            raise OSError(f"{path}: the STEP writer failed")


def write_stl(path: Path, part: Part) -> None:
    """Write a part as binary STL: no facet further than `STL_TOLERANCE_MM` from the part."""
    with atomic(path) as temporary:
        if not export_stl(part, temporary, STL_TOLERANCE_MM, STL_ANGLE_RAD):
            raise OSError(f"{path}: the STL writer failed")
