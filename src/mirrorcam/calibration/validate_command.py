"""`mirrorcam validate`: a blind calibration of a rendered set, checked against its ground truth."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, print_metrics, say
from mirrorcam.core.values import Metric


def validate(
    rendered: Annotated[Path, Parameter(name="SET", help="folder of a set that mirrorcam render wrote")],
    /,
    *,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/validated"),
    force: Force = False,
) -> int:
    """Calibrate a rendered set, and compare with its truth.

    Calibration and decoding use the pictures alone; the ground truth is read afterwards. Writes layout.json
    (calibrated), metrics.json, report.html, residuals.png and corners.csv. Exit code 1: a figure exceeds its limit.

    Examples:
        mirrorcam validate output/set
    """
    from mirrorcam.calibration.calibration_files import FILES, result_name
    from mirrorcam.calibration.validation import validate, write_validation
    from mirrorcam.core.disk.output_folder import output_folder

    with output_folder(out, "validate", force=force) as output:
        result = result_name(plain=False)
        output.refuse_others(result, *FILES)
        with long_work("validate", "blind calibration, comparison with the truth", "steps") as advance:
            validation = validate(rendered, progress=advance)
        with output.staged(result=result) as folder:
            write_validation(validation, folder, command="mirrorcam validate")
    print_metrics({"measured": validation.metrics})
    say("validate", _verdict(validation.metrics.values()))
    return 0 if validation.passed else 1


def _verdict(metrics: Iterable[Metric]) -> str:
    """The verdict in words: passed, or why figures failed."""
    failed = [metric for metric in metrics if not metric.passed]
    reasons = ["a figure exceeds its limit"] if any(metric.known for metric in failed) else []
    reasons += ["a figure that has a limit could not be computed"] if not all(metric.known for metric in failed) else []
    return f"failed: {', and '.join(reasons)}" if failed else "passed"
