"""`mirrorcam calibrate`: from pictures of a board to a calibrated layout."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, print_metrics, say
from mirrorcam.core.values import Metric, Value
from mirrorcam.optics.geometry.lenses.families import LENS_NAMES, LensName

if TYPE_CHECKING:
    from mirrorcam.optics.calibration.detection.next_pose import NextPose


class CalibrateOptions(Value):
    """Calibrate a mirror camera from pictures of a board: intrinsics and mirror planes, with uncertainties."""

    images: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="PICTURE...", help_behavior_hint="(or --corners)")
    ] = Field(default=(), description="pictures or videos of the board through the mirrors, or folders of pictures")
    board: Path = Field(description="board.toml of the target")
    corners: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE...", help_behavior_hint="")] = Field(
        default=(),
        description="tables of corners like corners.csv, of pictures with and without mirrors, in their place",
    )
    layout: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None,
        description="layout.json of the design, to start from; required without --direct-view",
    )
    base: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="PICTURE...", help_behavior_hint="")] = Field(
        default=(), description="pictures or videos of the board without mirrors, or folders of pictures"
    )
    direct_view: bool = Field(default=False, description="the camera also sees the board directly: no layout is needed")
    mirrors: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="")] = Bounds(1, 144).field(
        None, "number of mirrors, with --direct-view"
    )
    level: Annotated[str | None, tyro.conf.arg(metavar="LEVEL", help_behavior_hint="(chosen by tests)")] = Field(
        default=None,
        description=(
            "what is fitted: paper (mirrors only), joint (also the camera), or joint with any of +sheet (thickness of "
            "second-surface mirrors), +bend (curvature of each mirror), +warp (bending of the board) and +bow (bending "
            "of the board in each picture), as joint+bend; +rational, +prism, +fisheye and +spline are "
            "other lenses; with --direct-view joint with any of +sheet, +bow, +turn "
            "(of the camera in each picture) and +board (corners of the board)"
        ),
    )
    lens: Annotated[LensName | None, tyro.conf.arg(metavar="LENS", help_behavior_hint="(chosen by tests)")] = Field(
        default=None, description=f"the camera's lens, so that no other is tried: {', '.join(LENS_NAMES)}"
    )
    surface: Annotated[
        Literal["first", "second"] | None, tyro.conf.arg(metavar="{first,second}", help_behavior_hint="(the layout's)")
    ] = Field(
        default=None,
        description=(
            "which surface of the mirrors reflects, where the layout says otherwise; the thickness of plates that it "
            "does not have is found from the pictures"
        ),
    )
    live_hint: bool = Field(
        default=False,
        description=(
            "say after each picture (with --direct-view after all of them) at which mirror, distance and tilt the "
            "board should be in the next one; pictures are not taken: run the command again with more"
        ),
    )
    out: Path = Field(
        default=Path("output/calibrated"),
        description=(
            "folder for layout.json (calibrated), metrics.json, report.html, residuals.png and corners.csv (the "
            "corners used); detected corners are kept for the next time"
        ),
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        if bool(self.images) == bool(self.corners):
            raise ValueError("expected pictures, or --corners FILE")
        if self.corners and (self.base or self.live_hint or self.direct_view):
            raise ValueError("--corners goes without --base, --live-hint and --direct-view")
        if self.direct_view and (self.mirrors is None or self.layout is not None):
            raise ValueError("--direct-view goes with --mirrors N, without --layout")
        if self.direct_view and (self.lens is not None or self.surface is not None):
            raise ValueError("--lens and --surface go with --layout")
        if not self.direct_view and (self.layout is None or self.mirrors is not None):
            raise ValueError("expected --layout LAYOUT, or --direct-view with --mirrors N")
        return self


def run(options: CalibrateOptions) -> int:
    """Calibrate, write the result, and print its figures; 1 where the diagnostics contradict the model."""
    from mirrorcam.calibration.calibration_files import FILES, CalibrationRequest, calibrate_files, write_calibration
    from mirrorcam.core.disk.output_folder import output_folder, results_folder

    request = CalibrationRequest(
        board=options.board,
        pictures=options.images,
        corners=options.corners,
        layout=options.layout,
        base_pictures=options.base,
        mirrors=options.mirrors,
        level=options.level,
        lens=options.lens,
        surface=options.surface,
        detections=results_folder(options.out),
    )

    def on_hint(picture: str, hint: NextPose) -> None:
        say("calibrate", f"{picture}: {hint.sentence}")

    def tell(sentence: str) -> None:
        say("calibrate", sentence)

    with output_folder(options.out, "calibrate", force=options.force) as output:
        output.refuse_others(*FILES)
        with long_work("calibrate", "finding corners" if options.images else "solving", "pictures") as advance:
            calibration = calibrate_files(request, advance, on_hint if options.live_hint else None, tell)
        with output.staged(result="layout.json") as folder:
            write_calibration(calibration, folder, command="mirrorcam calibrate")
    shown: dict[str, Metric] = {n: m for n, m in calibration.metrics.items() if not n.startswith("mirror_")}
    print_metrics({"calibrated": shown})
    diagnostics = calibration.diagnostics
    notes, alarms = (diagnostics.notes, diagnostics.alarms) if diagnostics else ((), ())
    for note in (*calibration.notes, *notes):
        say("calibrate", note)
    for alarm in alarms:
        say("calibrate", f"alarm: {alarm}")
    say("calibrate", f"{options.out / 'layout.json'} and {options.out / 'report.html'} written")
    return 1 if alarms else 0
