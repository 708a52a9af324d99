"""Try six designs on two worker processes, and list their trade-offs.

    python examples/sweep_two_workers.py [OUT]

Interrupt it at any time: finished designs are kept, and the next run resumes. With the extra `cluster`,
`design_on_cluster` in place of `design_locally` shares the work among the workers of a Dask scheduler.
"""

import sys
from functools import partial
from pathlib import Path

import mirrorcam
from mirrorcam.designs.sweep_files import design_locally, write_sweep
from mirrorcam.optics.design.spec_grid import grid


def main(out: Path) -> None:
    # All combinations of the values below; all other fields are those of the common spec.
    specs = grid(
        mirrorcam.DesignSpec(min_edge_mm=2.0),
        counts=[(1, 2), (1, 3)],
        depth_sets_mm=[(300.0, 500.0)],
        scales_mm=[60.0],
        tradeoffs=[0.1, 0.3, 0.5],
    )
    sweep = write_sweep(specs, out, partial(design_locally, workers=2))

    # OUT/sweep.csv has a row for each design, OUT/layouts its layout, and OUT/pareto.png the figure of all designs.
    for outcome in sweep.outcomes:
        spec, figures = outcome.spec, outcome.metrics
        print(f"{spec.rows} x {spec.cols}, tradeoff {spec.tradeoff}: {outcome.status}")
        print(f"  grid error {figures['grid_error'].value:.3f}, baseline {figures['baseline_x_mm'].value:.0f} mm")


if __name__ == "__main__":  # worker processes import this file
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "output/examples/sweep"))
