"""Blind calibration of rendered sets against their truth: `python -m benchmarks.calibration_blind SET [SET ...]`.

Sets come from `mirrorcam render LAYOUT --renderer mitsuba --sensor c920 --frames 20 --seed N`, of layouts with
first- and second-surface mirrors (`mirrorcam design --surface second --thickness-mm 2`). Each is calibrated from its
frames, nominal layout and board alone before its truth is read. One with second-surface mirrors is calibrated once more
from the same corners as if they were first-surface, which must raise the alarm.
"""

from __future__ import annotations

import sys
from pathlib import Path

from mirrorcam.calibration.validation import validate
from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import load_board

SHOWN = (
    "held_out_rms_x_px",
    "held_out_rms_y_px",
    "normal_error_max_deg",
    "normal_error_between_mirrors_max_deg",
    "held_out_spatial_rms_mm",
    "distance_error_max_mm",
    "sheet_error_mm",
    "sheet_sigma_mm",
    "unexplained_px",
)


def by_frame(calibration: Calibration) -> tuple[list[Observations], list[Observations]]:
    """The corners of frames with and without mirrors, as `calibrate_corners` takes them."""
    rows = calibration.observations
    frames = [rows.where(rows.frame == n).shifted(-n) for n in range(len(calibration.rig_from_board))]
    return [o for o in frames if (o.view != DIRECT).any()], [o for o in frames if (o.view == DIRECT).all()]


def as_plane_mirrors(layout: Layout) -> Layout:
    """The layout as written by a user who does not know that its mirrors are second-surface mirrors."""
    return layout.replaced(mirrors=tuple(mirror.apparent for mirror in layout.mirrors), spec=None)


def main(folders: list[Path]) -> None:
    for folder in folders:
        validation = validate(folder)
        print(f"{folder.name}: {'passed' if validation.passed else 'past a limit'}")
        for name, metric in validation.metrics.items():
            if name in SHOWN or metric.limit is not None:
                limit = "" if metric.limit is None else f"  (limit {metric.limit:g})"
                print(f"  {name:40} {metric.value:10.5f} {metric.unit}{limit}")
        nominal = Layout.load(folder / "layout.json")
        if not nominal.mirrors[0].is_second_surface:
            continue
        seen, base = by_frame(validation.calibration)
        corners = load_board(folder / "board.toml").corners_in_board_mm
        try:
            plain = calibrate_corners(seen, base, as_plane_mirrors(nominal), corners, model=RequestedModel())
        except InputError as error:
            print(f"  as plane mirrors: refused: {error}")
            continue
        alarms = plain.diagnostics.alarms if plain.diagnostics is not None else ()
        print("  as plane mirrors: " + ("; ".join(alarms) or "NO ALARM"))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    main([Path(name) for name in sys.argv[1:]])
