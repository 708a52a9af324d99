"""`mirrorcam validate`: a blind calibration of a rendered set, checked against its ground truth."""

from __future__ import annotations

from pathlib import Path

import tyro
from pydantic import Field

from mirrorcam.console.progress import long_work, print_metrics, say
from mirrorcam.optics.base.values import Value


class ValidateOptions(Value):
    """Calibrate and decode a rendered set blind, then compare with its ground truth; exit 1 past any limit."""

    set: tyro.conf.Positional[Path] = Field(description="folder of a set that `mirrorcam render` wrote")
    out: Path = Field(
        default=Path("output/validated"),
        description="folder for layout.json (calibrated), metrics.json, report.html and residuals.png",
    )


def run(options: ValidateOptions) -> int:
    """Validate, and print every figure beside its limit."""
    from mirrorcam.workflow.validation import validate, write_validation

    with long_work("validate", "blind calibration, then the truth", "pictures") as advance:
        validation = validate(options.set, advance)
        write_validation(validation, options.out, command="mirrorcam validate")
    print_metrics({"measured": validation.metrics})
    say("validate", "passed" if validation.passed else "failed: a figure exceeds its limit")
    return 0 if validation.passed else 1
