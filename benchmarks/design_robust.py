"""What designs for devices as built gain: `python -m benchmarks.design_robust [--pinhole] [--json FILE]`.

3x3, C920, depths 300 and 500 mm. For trade-offs and folds, the design alone and that for mirrors tilted by 0.3 degrees
and shifted by 0.3 mm: grid error, usable efficiency, its median and 5 % quantile over 200 devices of the tolerances of
a hobbyist, with the same random numbers for each design; and the share of devices in which a mirror hides a part of
another. With `--pinhole`, for a camera with a pinhole, of which usable efficiency is pixel efficiency.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.records import Rows, add_json_option, short, write_record
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.as_built_views import BuiltViews, built_views
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.assess.monte_carlo import DEVICES
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_perturbations
from mirrorcam.optics.geometry.tolerances import Tolerances

HOBBY = Tolerances.hobby()
ROBUST = {
    "design alone": {},
    "apart": {"robust_offset_mm": HOBBY.offset_mm},
    "as built": {"robust_tilt_deg": HOBBY.tilt_deg, "robust_offset_mm": HOBBY.offset_mm},
}


def drawn(layout: Layout, tolerances: Tolerances, devices: int) -> BuiltViews:
    """The views of devices as built."""
    return built_views(layout, draw_perturbations(tolerances, len(layout.mirrors), devices, np.random.default_rng(0)))


def usable(views: BuiltViews, depth_mm: float) -> FloatArray:
    """Efficiency (n,) that the cameras of devices can use at a depth."""
    whole = views.through(views.layout.camera.pupil)
    return whole.pixel_efficiency(whole.common_regions(depth_mm)[0], depth_mm)


def row(layout: Layout, depths_mm: tuple[float, ...]) -> tuple[str, ...]:
    """Grid error, usable efficiency of the design, its median and 5 % quantile, and how many devices hide mirrors."""
    alone, devices = drawn(layout, Tolerances.none(), 1), drawn(layout, HOBBY, DEVICES)
    cells = []
    for depth_mm in depths_mm:
        values = usable(alone, depth_mm)[0], *np.percentile(usable(devices, depth_mm), [50.0, 5.0])
        cells.append(" / ".join(map(short, values)))
    hidden = 100.0 * devices.hidden().mean()
    return short(grid_error(layout)), *cells, f"{hidden:g} %" if hidden else "0"


def main() -> None:
    """Print a row for each design."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folds", type=float, nargs="+", default=[90.0, 120.0])
    parser.add_argument("--tradeoffs", type=float, nargs="+", default=[0.05, 0.1, 0.3])
    parser.add_argument("--pinhole", action="store_true", help="of a camera with a pinhole")
    add_json_option(parser)
    options = parser.parse_args()
    camera = Camera.c920()
    if options.pinhole:
        camera = camera.replaced(aperture_mm=0.0)
    found = Rows("fold", "trade-off", "optimised for", "grid error", "300 mm", "500 mm", "devices with hidden mirrors")
    for fold in options.folds:
        for tradeoff in options.tradeoffs:
            for name, changes in ROBUST.items():
                spec = DesignSpec(camera=camera, fold_deg=fold, tradeoff=tradeoff, **changes)
                layout = design(spec)
                found.add(f"{fold:g}°", short(tradeoff, 2).rstrip("0"), name, *row(layout, spec.depths_mm))
    write_record(options.json, "design_robust_pinhole" if options.pinhole else "design_robust", table=found.table)


if __name__ == "__main__":
    main()
