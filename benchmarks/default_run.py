"""Figures of the default run: `python -m benchmarks.default_run [FOLDER] [--json FILE]`.

Runs `mirrorcam run --out FOLDER`, which reuses valid results in FOLDER. The record `default_run` holds every
figure of its `metrics.json`. The record `model_camera` holds the figures of the same device rendered with the sensor
`c920`, whose lens and pupil obey the calibration's smallest model.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.records import Figure, add_json_option, write_record
from mirrorcam.calibration.validation import validate
from mirrorcam.cli import main as mirrorcam
from mirrorcam.core.disk.files import read_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.run.pipeline import full_recipe


def main() -> int:
    """Run the pipeline, and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("output/default"))
    add_json_option(parser)
    options = parser.parse_args()
    code = mirrorcam(["run", "--out", str(options.folder)])
    if code:
        return code
    try:
        content = read_json(options.folder / "metrics.json")
    except InputError as error:
        parser.error(str(error))
    metrics = {name: Metric.model_validate(value) for name, value in content.items()}
    values = {name: Figure(value=metric.value, unit=metric.unit) for name, metric in metrics.items()}
    write_record(options.json, "default_run", values, command="mirrorcam run")
    write_record(options.json, "model_camera", model_camera(Layout.load(options.folder / "design" / "layout.json")))
    return 0


def model_camera(layout: Layout) -> dict[str, Figure]:
    """Calibrate and decode the set of the default run, rendered with the sensor `c920`."""
    recipe = full_recipe(0)
    with tempfile.TemporaryDirectory() as folder:
        request = SetRequest(
            layout=layout,
            target=recipe.target,
            frames=recipe.frames,
            base_frames=recipe.base_frames,
            seed=recipe.seed,
            settings=recipe.settings.replaced(sensor=SENSORS["c920"]),
        )
        render_set(request, Path(folder, "set"))
        metrics = validate(Path(folder, "set")).metrics
    return {name: Figure(value=metric.value, unit=metric.unit) for name, metric in metrics.items()}


if __name__ == "__main__":
    sys.exit(main())
