"""`mirrorcam validate`: a blind calibration of a rendered set, checked against its ground truth."""

from __future__ import annotations

from pathlib import Path

import tyro
from pydantic import Field

from mirrorcam.commands.option_texts import FORCE
from mirrorcam.console.progress import long_work, print_metrics, say
from mirrorcam.optics.base.values import Value


class ValidateOptions(Value):
    """Calibrate and decode a rendered set blind, then compare with its ground truth; exit 1 past any limit."""

    set: tyro.conf.Positional[Path] = Field(description="folder of a set that `mirrorcam render` wrote")
    out: Path = Field(
        default=Path("output/validated"),
        description="folder for layout.json (calibrated), metrics.json, report.html, residuals.png and corners.csv",
    )
    force: bool = FORCE


def run(options: ValidateOptions) -> int:
    """Validate, and print every figure beside its limit."""
    from mirrorcam.workflow.calibration_files import FILES
    from mirrorcam.workflow.output_folder import output_folder
    from mirrorcam.workflow.validation import validate, write_validation

    with output_folder(options.out, "validate", force=options.force) as output:
        output.refuse_others(*FILES)
        with long_work("validate", "blind calibration, comparison with the truth", "pictures") as advance:
            validation = validate(options.set, advance)
        with output.staged(result="layout.json") as folder:
            write_validation(validation, folder, command="mirrorcam validate")
    print_metrics({"measured": validation.metrics})
    say("validate", "passed" if validation.passed else "failed: a figure exceeds its limit")
    return 0 if validation.passed else 1
