"""Design a camera of two mirrors, and write every file that is needed to build it.

    python examples/design_and_export_parts.py [OUT]

Needs the extra `cad`. Afterwards open OUT/device/index.html.
"""

import sys
from pathlib import Path

import mirrorcam


def main(out: Path) -> None:
    # The request: one row of two mirrors above a Logitech C920, with views that overlap at 300 and 500 mm.
    spec = mirrorcam.DesignSpec(rows=1, cols=2, depths_mm=(300.0, 500.0))

    # The optimiser returns a layout: the camera and the mirrors, all in mm in the frame of the camera ("rig").
    layout = mirrorcam.design(spec)
    layout.save(out / "layout.json")
    for name in ("grid_error", "pixel_efficiency_300mm", "pixel_efficiency_500mm", "baseline_x_mm"):
        figure = layout.metrics[name]
        print(f"{name}: {figure.value:.3g} {figure.unit}")

    # Parts to print, mirrors to cut, drawings and a guide. A figure with a limit is a check.
    figures = mirrorcam.build_parts(layout, out / "device", workers=2)
    checks = {name: figure for name, figure in figures.items() if figure.limit is not None}
    failed = [name for name, check in checks.items() if not check.passed]
    print(f"{len(checks)} checks and {len(figures) - len(checks)} figures without a limit")
    print(f"checks failed: {', '.join(failed) or 'none'}")


if __name__ == "__main__":  # build_parts starts worker processes, which import this file
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "output/examples/parts"))
