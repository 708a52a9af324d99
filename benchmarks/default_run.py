"""Figures of the default run: `python -m benchmarks.default_run [FOLDER] [--json FILE]`.

Runs `mirrorcam run --out FOLDER`, which reuses valid results in FOLDER. The record `default_run` holds every
figure of its `metrics.json`. The record `model_camera` holds the figures of the same device rendered with the sensor
`c920`, whose lens and pupil obey the calibration's smallest model. The record `lateral_colour` tells how wide
the fringes of its decoded views are, with the lateral colour that the calibration found and without; `raw_colour` the
same without compression, which keeps only a blurred part of them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.records import Figure, add_json_option, write_record
from mirrorcam.calibration.validation import Validation, validate
from mirrorcam.cli import main as mirrorcam
from mirrorcam.core.disk.files import read_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.settings import SENSORS, SensorModel
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
    calibrated = Layout.load(options.folder / "validation" / "layout.json")
    write_record(options.json, "lateral_colour", fringes(calibrated, options.folder / "set" / "frames"))
    design = Layout.load(options.folder / "design" / "layout.json")
    with tempfile.TemporaryDirectory() as folder:
        found = rendered_again(design, SENSORS["webcam"].replaced(jpeg_quality=None), Path(folder, "set"))
        write_record(options.json, "raw_colour", fringes(found.calibration.layout, Path(folder, "set", "frames")))
    with tempfile.TemporaryDirectory() as folder:
        metrics = rendered_again(design, SENSORS["c920"], Path(folder, "set")).metrics
    figures = {name: Figure(value=metric.value, unit=metric.unit) for name, metric in metrics.items()}
    write_record(options.json, "model_camera", figures)
    return 0


def fringes(layout: Layout, frames: Path) -> dict[str, Figure]:
    """Measure the colour fringes in decoded views of a grey board, with and without the lateral colour of a layout.

    Both are RMS differences of red and blue from green, in grey levels.
    """
    figures = {}
    for name, colour in (("corrected", layout.camera.lateral_colour), ("uncorrected", None)):
        decoder = Decoder(layout.replaced(camera=layout.camera.replaced(lateral_colour=colour)))
        squares, pixels = np.zeros(2), 0
        for frame in sorted(frames.iterdir()):
            samples = decoder.decode(read_image(frame)).samples
            seen = samples[samples.min(axis=-1) > 0].astype(np.float64)
            squares += np.sum((seen[:, [0, 2]] - seen[:, [1]]) ** 2, axis=0)
            pixels += len(seen)
        for channel, square in zip(("red", "blue"), squares, strict=True):
            figures[f"{channel}_{name}"] = Figure(value=float(np.sqrt(square / pixels)))
    return figures


def rendered_again(layout: Layout, sensor: SensorModel, folder: Path) -> Validation:
    """Render the set of the default run with another sensor, and calibrate and decode it."""
    recipe = full_recipe(0)
    render_set(replace(recipe, settings=recipe.settings.replaced(sensor=sensor)).set_request(layout), folder)
    return validate(folder)


if __name__ == "__main__":
    sys.exit(main())
