"""`mirrorcam calibrate`: from pictures of a board to a calibrated layout."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, print_metrics, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric

if TYPE_CHECKING:
    from mirrorcam.optics.calibration.detection.next_pose import NextPose


def calibrate(
    pictures: Annotated[
        tuple[Path, ...],
        Parameter(
            name="PICTURE...",
            help="pictures, folders of them, videos or ROS 2 bags that show the board in the mirrors; without --layout "
            "and --direct-view, the pictures of a camera without mirrors",
        ),
    ] = (),
    /,
    *,
    request: CalibrationRequest | None = None,
    live_hint: Annotated[
        bool,
        Parameter(
            help="after each picture (with --direct-view, after the last) recommend the mirror, distance and tilt of "
            "the board for the next one"
        ),
    ] = False,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/calibrated"),
    force: Force = False,
) -> int:
    """Calibrate a device, or a camera, from pictures of a board.

    Writes layout.json (calibrated: intrinsics and mirror planes, with uncertainties) or camera.json (intrinsics of a
    camera without mirrors), metrics.json, report.html, residuals.png and corners.csv (the corners used; from labels:
    labels.csv, and points.csv with the points in space). Detected corners are stored, so that no picture is searched
    twice. Exit code 1: the diagnostics raise an alarm, because the pictures contradict the model.

    Examples:
        mirrorcam calibrate through_mirrors/ --base without_mirrors/ --layout layout.json --board board.toml
        mirrorcam calibrate through_mirrors/ --layout layout.json --board board.toml --model fisheye+bend
        mirrorcam calibrate clip.mp4 --board board.toml --direct-view 2
        mirrorcam calibrate without_mirrors/ --board board.toml --camera c920
        mirrorcam calibrate --labels labels.csv --camera camera.yaml --known-length nose tail 95
    """
    if request is None:
        raise InputError("expected --board FILE, or --labels FILE without a board")
    if request.labels:
        if live_hint:
            raise InputError("--live-hint works only with pictures of a board, expected no --labels")
        return _calibrate_from_labels(pictures, request, out, force=force)
    from mirrorcam.calibration.calibration_files import FILES, calibrate_files, result_name, write_calibration
    from mirrorcam.core.disk.output_folder import output_folder, results_folder
    from mirrorcam.optics.calibration.diagnostics.verdict import STATES, check_solution
    from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures

    def on_hint(picture: str, hint: NextPose) -> None:
        say("calibrate", f"{picture}: {hint.sentence}")

    with output_folder(out, "calibrate", force=force) as output:
        result = result_name(plain=request.is_plain)
        output.refuse_others(result, *FILES)
        with long_work("calibrate", "finding corners" if pictures else "solving", "steps") as advance:
            calibration = calibrate_files(
                pictures,
                request,
                detections=results_folder(out),
                progress=advance,
                on_hint=on_hint if live_hint else None,
                on_note=lambda sentence: say("calibrate", sentence),
                on_step=lambda step: say("calibrate", f"{step} ..."),
            )
        with output.staged(result=result) as folder:
            write_calibration(calibration, folder, command="mirrorcam calibrate")
    printed: dict[str, Metric] = {n: m for n, m in calibration.metrics.items() if not n.startswith("mirror_")}
    print_metrics({"calibrated": printed})
    diagnostics = calibration.diagnostics
    notes, alarms = (diagnostics.notes, diagnostics.alarms) if diagnostics else ((), ())
    for note in (*calibration.notes, *notes):
        say("calibrate", note)
    verdict = check_solution(calibration, view_figures(calibration))
    for reason in verdict.reasons:
        say("calibrate", f"alarm: {reason}" if alarms else reason)
    for advice in verdict.advice:
        say("calibrate", f"next: {advice}")
    say("calibrate", f"{STATES[verdict.state]}: {out / result} and {out / 'report.html'} written")
    return 1 if alarms else 0


def _calibrate_from_labels(pictures: tuple[Path, ...], request: CalibrationRequest, out: Path, *, force: bool) -> int:
    from mirrorcam.calibration.label_outputs import FILES, calibrate_label_files, write_label_calibration
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.calibration.labels.label_verdict import label_verdict

    with output_folder(out, "calibrate", force=force) as output:
        output.refuse_others(*FILES)
        result = calibrate_label_files(pictures, request, on_note=lambda sentence: say("calibrate", sentence))
        with output.staged(result="layout.json") as folder:
            write_label_calibration(result, folder, command="mirrorcam calibrate")
    metrics = result.calibration.metrics
    print_metrics({"calibrated": {name: m for name, m in metrics.items() if not name.startswith("mirror_")}})
    verdict = label_verdict(result)
    for note in result.calibration.notes:
        say("calibrate", note)
    for reason in verdict.reasons:
        say("calibrate", f"alarm: {reason}" if verdict.state == "stop" else reason)
    say("calibrate", f"{out / 'layout.json'} and {out / 'report.html'} written")
    return 1 if verdict.state == "stop" else 0
