"""`mirrorcam drift`: whether mirrors moved since the calibration, told from pictures of any scene."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.figures.figure_texts import SIGMA
from mirrorcam.core.values import Value

if TYPE_CHECKING:
    from mirrorcam.optics.drift.drift import Drift, MirrorMove
    from mirrorcam.optics.geometry.layout import Layout


class DriftOptions(Value):
    """Tell from pictures of any scene whether mirrors moved since the calibration, and re-solve those that did."""

    frames: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FRAME|VIDEO...")] = Field(
        min_length=1,
        description="frames of the camera (PNG, JPEG, TIFF or BMP), or videos, of one recording of a textured scene",
    )
    layout: Path = Field(description="calibrated layout.json")
    checks: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(the limit that parts are designed to)")
    ] = Field(default=None, description="checks.json of the device by `mirrorcam cad`: how far gravity bends its mount")
    out: Path = Field(
        default=Path("output/drift"), description="folder for drift.json, and layout.json where mirrors are re-solved"
    )
    force: bool = FORCE


def run(options: DriftOptions) -> int:
    """Test, write and print; 1 where a mirror moved, or pictures do not tell."""
    from mirrorcam.calibration.drift_check import drift_line
    from mirrorcam.calibration.drift_files import FILES, find_drift_files, write_drift_files
    from mirrorcam.calibration.stiffness import bending_line, mount_tilt
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.geometry.layout import Layout

    layout = Layout.load(options.layout)
    tilt = mount_tilt(options.checks)
    with output_folder(options.out, "drift", force=options.force) as output:
        output.refuse_others(*FILES)
        drift = find_drift_files(options.frames, layout, options.layout, partial(say, "drift"))
        with output.staged(result="drift.json") as folder:
            write_drift_files(layout, drift, tilt, [path.name for path in options.frames], folder)
    _print(layout, drift)
    say("drift", drift_line(layout, drift))
    say("drift", bending_line(drift, tilt))
    resolved = f"; {options.out / 'layout.json'} has the mirrors where they are now" if drift.moved else ""
    say("drift", f"{options.out / 'drift.json'} written{resolved}")
    return 1 if drift.moved or drift.untold else 0


def _print(layout: Layout, drift: Drift) -> None:
    """Print a row for each mirror."""
    rows = [
        (
            f"mirror {layout.mirror_names[mirror.index]}",
            *_figures(mirror),
            str(mirror.points),
        )
        for mirror in drift.mirrors
    ]
    print_table(["", "turn °", f"{SIGMA} °", "shift mm", "of threshold", "tells from °", "points"], rows)
    say("drift", "of threshold: over 1, the mirror has moved; tells from: a turn of this size would show")


def _figures(mirror: MirrorMove) -> tuple[str, ...]:
    """Turn and its sigma, shift, statistic and what is told, as far as pictures tell."""
    if not mirror.tested:
        return ("-",) * 5
    return (
        f"{mirror.size_deg:.4f}",
        f"{mirror.turn_sigma_deg:.4f}",
        f"{mirror.shift_mm:+.3f}",
        f"{mirror.statistic:.2f}",
        f"{mirror.tells_deg:.3f}",
    )
