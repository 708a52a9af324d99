"""`mirrorcam calibrate`: from pictures of a board to a calibrated layout."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.console.progress import Advance, long_work, print_metrics, say
from mirrorcam.optics.base.values import InputError, Metric, Value

if TYPE_CHECKING:
    from mirrorcam.optics.calibration.detection.checkerboard import Grey
    from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
    from mirrorcam.optics.calibration.solver.observations import Observations


class CalibrateOptions(Value):
    """Calibrate a mirror camera from pictures of a board: its intrinsics and 3 numbers per mirror, with sigmas."""

    images: tyro.conf.Positional[tuple[Path, ...]] = Field(min_length=1, description="pictures, or folders of them")
    board: Path = Field(description="board.toml")
    layout: Path | None = Field(default=None, description="nominal layout.json: where to look and where to start")
    base: tuple[Path, ...] = Field(default=(), description="pictures without mirrors, or folders of them")
    direct_view: bool = Field(
        default=False, description="the camera sees a checkerboard directly, too, so that no layout is needed"
    )
    mirrors: int | None = Field(default=None, ge=1, le=4, description="how many mirrors, with --direct-view")
    level: str | None = Field(
        default=None,
        description="model: paper, or joint with any of +sheet, +bend, +warp; without it, what the pictures support",
    )
    live_hint: bool = Field(
        default=False, description="say after each picture which mirror, depth and tilt the next one should show"
    )
    out: Path = Field(
        default=Path("output/calibrated"),
        description=(
            "folder for layout.json (calibrated), metrics.json, report.html and residuals.png; what was found in a "
            "picture is kept in detections/, so that none is searched twice"
        ),
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.direct_view and (self.mirrors is None or self.layout is not None or self.base):
            raise ValueError("--direct-view goes with --mirrors N, without --layout and --base")
        if self.direct_view and (self.level is not None or self.live_hint):
            raise ValueError("--level and --live-hint go with --layout")
        if not self.direct_view and (self.layout is None or self.mirrors is not None):
            raise ValueError("expected --layout LAYOUT, or --direct-view with --mirrors N")
        return self


def pictures_in(paths: Sequence[Path]) -> list[Path]:
    """The pictures themselves: a folder stands for all pictures in it, by name."""
    from mirrorcam.optics.base.files import PICTURE_ENDINGS, is_picture

    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = sorted(p for p in path.iterdir() if is_picture(p))
            if not inside:
                raise InputError(f"{path}: holds no picture, expected {', '.join(PICTURE_ENDINGS)} files")
            found += inside
        else:
            found.append(path)
    return found


def calibrate_pictures(options: CalibrateOptions, advance: Advance) -> Calibration:
    """The calibration that the options ask for; every picture is read one at a time."""
    from mirrorcam.optics.base.files import read_image
    from mirrorcam.optics.calibration.calibration import calibrate
    from mirrorcam.optics.calibration.detection.next_pose import NextPosePlanner
    from mirrorcam.optics.calibration.direct.direct_view import calibrate_with_direct_view
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.optics.geometry.targets import Checkerboard, load_board
    from mirrorcam.workflow.workers import cores

    target = load_board(options.board)
    paths, base_paths = pictures_in(options.images), pictures_in(options.base)

    def images(of: list[Path]) -> Iterator[Grey]:
        return (read_image(path, grey=True) for path in of)

    if options.layout is not None:
        layout = Layout.load(options.layout)
        total = len(paths) + len(base_paths)

        planner = NextPosePlanner(layout, target) if options.live_hint else None

        def hint(seen: Sequence[Observations]) -> None:
            if planner is not None:
                say("calibrate", f"{paths[len(seen) - 1].name}: {planner.after(seen[-1]).sentence}")

        return calibrate(
            images(paths),
            images(base_paths),
            layout,
            target,
            level=options.level,
            detections=options.out / "detections",
            workers=cores(),
            on_frame=lambda done: advance(done, total),
            on_seen=hint,
        )
    if not isinstance(target, Checkerboard) or options.mirrors is None:
        raise InputError(f"{options.board}: a ChArUco board, expected a checkerboard for --direct-view")
    return calibrate_with_direct_view(
        list(images(paths)), target, mirrors=options.mirrors, names=[path.name for path in paths], on_picture=advance
    )


def write_calibration(calibration: Calibration, out: Path, *, command: str) -> None:
    """Write layout.json, metrics.json, report.html and residuals.png into `out`, each atomically."""
    from mirrorcam.figures.calibration_figure import residual_figure
    from mirrorcam.optics.base.files import write_metrics
    from mirrorcam.pages.calibration.calibration_page import write_report

    residual_figure(calibration, out / "residuals.png")
    write_report(calibration, out / "report.html", command=command)
    write_metrics(out / "metrics.json", calibration.metrics)
    calibration.layout.save(out / "layout.json")


def run(options: CalibrateOptions) -> int:
    """Calibrate, write the result, and print its figures; 1 where the diagnostics speak against the model."""
    with long_work("calibrate", "finding corners", "pictures") as advance:
        calibration = calibrate_pictures(options, advance)
        write_calibration(calibration, options.out, command="mirrorcam calibrate")
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
