"""`mirrorcam drift`: whether mirrors moved since the calibration, from pictures of any scene."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force, Layout
from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.figures.figure_texts import SIGMA

if TYPE_CHECKING:
    from mirrorcam.optics.drift.drift import Drift, MirrorMove
    from mirrorcam.optics.geometry import layout as layouts


def drift(
    frames: Annotated[
        tuple[Path, ...],
        Parameter(
            name="FRAME|VIDEO...",
            help="frames (PNG, JPEG, TIFF or BMP) or videos of one recording of a textured scene",
        ),
    ],
    /,
    *,
    layout: Layout,
    checks: Annotated[
        Path | None,
        Parameter(
            metavar="FILE",
            help="checks.json that mirrorcam cad wrote for the device, with the tilt of its mount by gravity "
            "[default: the limit that parts are designed for]",
        ),
    ] = None,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/drift"),
    force: Force = False,
) -> int:
    """Detect mirrors that moved since the calibration.

    Needs pictures of any textured scene. Writes drift.json and, if mirrors moved, layout.json with their new planes.
    Exit code 1: a mirror moved, or the pictures cannot show whether one did.

    Examples:
        mirrorcam drift recording.mp4 --layout calibrated/layout.json
    """
    from mirrorcam.calibration.drift_check import (
        FILES,
        bending_line,
        drift_line,
        find_drift_files,
        mount_tilt,
        write_drift_files,
    )
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.geometry.layout import Layout as DeviceLayout

    calibrated = DeviceLayout.load(layout)
    tilt = mount_tilt(checks)
    with output_folder(out, "drift", force=force) as output:
        output.refuse_others(*FILES)
        result = find_drift_files(frames, calibrated, layout, partial(say, "drift"))
        with output.staged(result="drift.json") as folder:
            write_drift_files(calibrated, result, tilt, [path.name for path in frames], folder)
    _print(calibrated, result)
    say("drift", drift_line(calibrated, result))
    say("drift", bending_line(result, tilt))
    resolved = f"; {out / 'layout.json'} has the mirrors' new positions" if result.moved else ""
    say("drift", f"{out / 'drift.json'} written{resolved}")
    return 1 if result.moved or result.undetermined else 0


def _print(layout: layouts.Layout, result: Drift) -> None:
    """Print a row for each mirror."""
    rows = [
        (f"mirror {layout.mirror_names[mirror.index]}", *_figures(mirror), str(mirror.points))
        for mirror in result.mirrors
    ]
    print_table(["", "rotation °", f"{SIGMA} °", "shift mm", "of threshold", "detectable °", "points"], rows)
    say("drift", "of threshold: over 1, the mirror has moved; detectable: the smallest rotation that would be detected")


def _figures(mirror: MirrorMove) -> tuple[str, ...]:
    """Rotation and its sigma, shift, statistic and smallest detectable rotation, as far as pictures determine them."""
    if not mirror.tested:
        return ("-",) * 5
    return (
        f"{mirror.angle_deg:.4f}",
        f"{mirror.rotation_sigma_deg:.4f}",
        f"{mirror.shift_mm:+.3f}",
        f"{mirror.statistic:.2f}",
        f"{mirror.detectable_deg:.3f}",
    )
