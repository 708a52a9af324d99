"""What focus and aperture a design needs to be sharp at its depths: `python -m benchmarks.design_focus [--json FILE]`.

3x3, C920, designs at scales of 60, 80 and 120 mm for three pairs of depths: the largest circle of confusion with the
camera's focus and with the best, and the largest aperture with which the latter is within the limit.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.processes.worker_pool import call_all
from mirrorcam.core.values import Metric
from mirrorcam.optics.design.assess.focus import CIRCLE_LIMIT_PX
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec

SCALES_MM = (60.0, 80.0, 120.0)
DEPTHS_MM = ((400.0, 600.0), (300.0, 500.0), (300.0, 1000.0))


def metrics_of(spec: DesignSpec) -> dict[str, Metric]:
    """The figures of `design`'s answer to a spec."""
    return design(spec).metrics


def main(workers: int, json: Path | None) -> None:
    specs = [DesignSpec(scale_mm=scale, depths_mm=depths, fold_deg=90.0) for depths in DEPTHS_MM for scale in SCALES_MM]
    limit = f"largest aperture for {CIRCLE_LIMIT_PX:g} px"
    found = Rows("depths", "scale", "circles as focused", "best focus", "largest circle then", limit)
    for spec, metrics in zip(specs, call_all([(metrics_of, (spec,)) for spec in specs], workers), strict=True):
        circles = " / ".join(f"{metrics[f'circle_of_confusion_{depth:g}mm'].value:.1f}" for depth in spec.depths_mm)
        best_mm, least_px = (metrics[name].value for name in ("best_focus_mm", "circle_at_best_focus_px"))
        largest_mm = spec.camera.aperture_mm * CIRCLE_LIMIT_PX / least_px
        depths = " / ".join(f"{depth:g}" for depth in spec.depths_mm)
        lengths = (f"{best_mm:.0f} mm", f"{least_px:.2f} px", f"{largest_mm:.2f} mm")
        found.add(f"{depths} mm", f"{spec.scale_mm:g} mm", f"{circles} px", *lengths)
    write_record(json, "design_focus", table=found.table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    add_json_option(parser)
    options = parser.parse_args()
    main(options.workers, options.json)
