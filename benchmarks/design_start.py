"""The optimised design beside the faceted parabola, its start: `python -m benchmarks.design_start [--json FILE]`.

3 x 3, Logitech C920, scale 80 mm, depths 300 and 500 mm, spacing 1 mm: grid error, and pixel and usable efficiency at
both depths, at folds of 90 and 120 degrees.
"""

from __future__ import annotations

import argparse

from benchmarks.records import Table, add_json_option, table, write_record
from mirrorcam.optics.design.optimise import assessed_parabola, design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

FOLDS_DEG = (90.0, 120.0)
KINDS = ("pixel_efficiency", "usable_efficiency")
HEAD = ("", "grid error", "pixel efficiency 300 / 500 mm", "usable")


def spec_of(fold_deg: float) -> DesignSpec:
    """The default design at a fold."""
    return DesignSpec(rows=3, cols=3, camera=Camera.c920(), depths_mm=(300.0, 500.0), fold_deg=fold_deg)


def figures_of(layout: Layout) -> dict[str, float]:
    """What a design is compared by."""
    names = ("grid_error", *(f"{kind}_{depth_mm}mm" for kind in KINDS for depth_mm in (300, 500)))
    return {name: layout.metrics[name].value for name in names}


def comparison(found: dict[tuple[str, float], dict[str, float]]) -> Table:
    """The designs beside their starts."""
    rows = []
    for (name, fold_deg), each in found.items():
        pairs = (f"{each[f'{kind}_300mm']:.3f} / {each[f'{kind}_500mm']:.3f}" for kind in KINDS)
        rows.append((f"{name}, fold {fold_deg:.0f}°", f"{each['grid_error']:.3f}", *pairs))
    return table(HEAD, rows)


def main() -> None:
    """Design, print the table, write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_json_option(parser)
    options = parser.parse_args()
    found = {}
    for name, made in (("faceted parabola", assessed_parabola), ("optimised", design)):
        for fold_deg in FOLDS_DEG:
            found[name, fold_deg] = figures_of(made(spec_of(fold_deg)))
    values = {
        f"{name.split()[-1]}_{fold_deg:.0f}.{figure}": value
        for (name, fold_deg), each in found.items()
        for figure, value in each.items()
    }
    result = comparison(found)
    print(result.markdown())
    write_record(options.json, "design_start", values, result)


if __name__ == "__main__":
    main()
