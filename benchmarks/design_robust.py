"""What designs for devices as built gain: `python -m benchmarks.design_robust [--folds 90 125] [--pinhole]`.

3x3, C920, depths 300 and 500 mm. For trade-offs and folds, the design alone and that for mirrors tilted by 0.3 degrees
and shifted by 0.3 mm: grid error, usable efficiency, its median and 5 % quantile over 200 devices of the tolerances of
a hobbyist, with the same random numbers for each design; and the share of devices in which a mirror hides a part of
another. With `--pinhole`, for a camera with a pinhole, of which usable efficiency is pixel efficiency.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from mirrorcam.optics.design.assess.as_built_views import built_views
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.assess.monte_carlo import DEVICES
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_as_built, draw_perturbations
from mirrorcam.optics.geometry.sub_images import fields_of_view
from mirrorcam.optics.geometry.tolerances import Tolerances

HOBBY = Tolerances.hobby()
ROBUST = {
    "design alone": {},
    "no mirror hidden": {"robust_offset_mm": HOBBY.offset_mm},
    "as built": {"robust_tilt_deg": HOBBY.tilt_deg, "robust_offset_mm": HOBBY.offset_mm},
}


def figures(layout: Layout, depths_mm: tuple[float, ...]) -> list[list[float]]:
    """Design, median and 5 % quantile at each depth of the efficiency that its camera can use."""
    pupil, random = layout.camera.pupil, np.random.default_rng(0)
    devices = [layout, *(draw_as_built(layout, HOBBY, random) for _ in range(DEVICES))]
    views = [fields_of_view(device, pupil) for device in devices]
    found = []
    for depth_mm in depths_mm:
        shares = [view.pixel_efficiency(view.common_region(depth_mm)[0], depth_mm) for view in views]
        found.append([shares[0], *np.percentile(shares[1:], [50.0, 5.0])])
    return found


def hidden(layout: Layout) -> float:
    """The share of devices in which a mirror hides a part of another."""
    drawn = draw_perturbations(HOBBY, len(layout.mirrors), DEVICES, np.random.default_rng(0))
    return float(built_views(layout, drawn).hidden().mean())


def main() -> None:
    """Print a row for each design."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folds", type=float, nargs="+", default=[90.0, 125.0])
    parser.add_argument("--tradeoffs", type=float, nargs="+", default=[0.05, 0.1, 0.3])
    parser.add_argument("--pinhole", action="store_true", help="of a camera with a pinhole")
    options = parser.parse_args()
    camera = Camera.c920()
    if options.pinhole:
        camera = camera.replaced(aperture_mm=0.0)
    print("| fold | trade-off | optimised for | grid error | 300 mm: design, median, 5 % | 500 mm | hidden | s |")
    print("|---|---|---|---|---|---|---|---|")
    for fold in options.folds:
        for tradeoff in options.tradeoffs:
            for name, changes in ROBUST.items():
                started = time.perf_counter()
                spec = DesignSpec(camera=camera, fold_deg=fold, tradeoff=tradeoff, **changes)
                layout = design(spec)
                took = time.perf_counter() - started
                texts = [" / ".join(f"{v:.3f}" for v in values) for values in figures(layout, spec.depths_mm)]
                print(
                    f"| {fold:g}° | {tradeoff:g} | {name} | {grid_error(layout):.3f} | {texts[0]} | {texts[1]} "
                    f"| {hidden(layout):.1%} | {took:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
