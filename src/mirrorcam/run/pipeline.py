"""The pipeline: design, parts, synthetic set, blind calibration checked against the ground truth, light field, page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from mirrorcam.calibration.validation import validate, write_validation
from mirrorcam.core.console.reporter import SILENT, Reporter
from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.disk.output_folder import OutputFolder, output_folder, results_folder
from mirrorcam.core.disk.program import NOT_INSTALLED
from mirrorcam.core.disk.stages import Stage, perform, refuse_foreign, staleness
from mirrorcam.core.extras import require
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.progress import Progress
from mirrorcam.core.values import Metric
from mirrorcam.designs.design_files import write_design
from mirrorcam.lightfield.decoding import decode_picture
from mirrorcam.optics.geometry.boards import CalibrationBoard, Charuco, default_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from mirrorcam.run.run_page import read_metrics, write_page, write_pictures

if TYPE_CHECKING:
    from mirrorcam.render_scenes.sets.set_request import SetRequest

# Index of the frame that the page shows decoded.
SHOWN_FRAME = 0
# Maps of all pixels take 18 MB per frame, and no stage reads them.
SETTINGS = RenderSettings(sensor=SENSORS["webcam"], maps=False)


@dataclass(frozen=True)
class Recipe:
    """All inputs that determine the results of a run."""

    spec: DesignSpec
    board: CalibrationBoard
    frames: int
    base_frames: int
    settings: RenderSettings
    seed: int
    small: bool
    adapter: str = "none"
    """Kind of the back to which the device is attached."""
    mounting: Literal["glue", "tape", "screws"] = "glue"
    """How the mirrors are mounted."""

    def set_request(self, layout: Layout) -> SetRequest:
        """The request for the synthetic set of a layout."""
        from mirrorcam.render_scenes.sets.set_request import SetRequest

        return SetRequest(
            layout=layout,
            board=self.board,
            frames=self.frames,
            base_frames=self.base_frames,
            seed=self.seed,
            settings=self.settings,
        )


def full_recipe(seed: int) -> Recipe:
    """Return the nominal 3x3 camera at 1920x1080 with 20 frames."""
    return Recipe(DesignSpec(), default_board(), frames=20, base_frames=10, settings=SETTINGS, seed=seed, small=False)


def quick_recipe(seed: int) -> Recipe:
    """Return a small example: 2x2 mirrors, a camera of half the resolution, a board with larger squares, few frames.

    It meets the limits of the full run by a factor of about two, whatever the seed.
    """
    spec = DesignSpec(camera=Camera.c920().binned(0.5), rows=2, cols=2)
    board = Charuco(cols=12, rows=8, square_mm=24.0, marker_mm=18.0)
    return Recipe(spec, board, frames=8, base_frames=6, settings=SETTINGS, seed=seed, small=True)


def stages(recipe: Recipe, root: Path) -> tuple[Stage, ...]:
    """Return the stages of a run into `root`, in order."""
    nominal, synthetic = root / "design" / "layout.json", root / "set"
    frame = synthetic / "frames" / f"{SHOWN_FRAME:04d}{recipe.settings.suffix}"
    calibrated = root / "validation" / "layout.json"

    def design(folder: Path, progress: Progress) -> None:
        write_design(recipe.spec, folder, progress=progress)

    def part(folder: Path, progress: Progress) -> None:
        from mirrorcam.cad.build import build_parts
        from mirrorcam.cad.plan.back_table import back_of
        from mirrorcam.cad.plan.hardware import HARDWARE

        layout = Layout.load(nominal)
        hardware = HARDWARE.for_mirrors_of(layout)
        holder = hardware.holder.replaced(mirrors=recipe.mounting)
        hardware = hardware.replaced(back=back_of(recipe.adapter), holder=holder)
        stored = results_folder(root)
        build_parts(layout, folder, hardware, results=stored, workers=cores(), progress=progress)

    def render(folder: Path, progress: Progress) -> None:
        from mirrorcam.render_scenes.sets.render_set import render_set

        render_set(recipe.set_request(Layout.load(nominal)), folder, progress=progress)

    def check(folder: Path, progress: Progress) -> None:
        write_validation(validate(synthetic, progress=progress), folder, command="mirrorcam run")

    def decode(folder: Path, progress: Progress) -> None:
        decode_picture(frame, Decoder(Layout.load(calibrated)), folder)

    def pictures(folder: Path, progress: Progress) -> None:
        write_pictures(frame, root / "light_field" / f"{frame.stem}_views.png", folder)

    return (
        Stage(
            "design",
            design,
            "mirrorcam.designs.design_files",
            doing=f"{recipe.spec.arrangement.text} mirrors",
            parameters={"spec": recipe.spec.model_dump(mode="json")},
        ),
        Stage(
            "cad",
            part,
            "mirrorcam.cad.build",
            doing="every part, its files and checks",
            unit="steps",
            parameters={"adapter": recipe.adapter, "mirrors": recipe.mounting},
            reads=(nominal,),
            programs={"slicer": _slicer()},
        ),
        Stage(
            "set",
            render,
            "mirrorcam.render_scenes.sets.render_set",
            doing=f"{recipe.frames} frames via the mirrors and {recipe.base_frames} without",
            unit="frames",
            parameters={
                "board": recipe.board.model_dump(mode="json"),
                "frames": recipe.frames,
                "base_frames": recipe.base_frames,
                "seed": recipe.seed,
                "settings": recipe.settings.model_dump(mode="json"),
            },
            reads=(nominal,),
            resumes=True,
        ),
        Stage(
            "validation",
            check,
            "mirrorcam.calibration.validation",
            doing="blind calibration, comparison with the ground truth",
            reads=(synthetic,),
            unit="pictures",
        ),
        Stage(
            "light_field",
            decode,
            "mirrorcam.lightfield.decoding",
            doing="views of one frame",
            unit="frames",
            reads=(calibrated, frame),
        ),
        Stage(
            "page",
            pictures,
            "mirrorcam.run.run_page",
            doing="pictures for the page",
            reads=(frame, root / "light_field" / f"{frame.stem}_views.png"),
        ),
    )


def _slicer() -> str:
    from mirrorcam.cad.write.slicer import slicer_version

    return slicer_version() or NOT_INSTALLED


def finish(stage: Stage, output: OutputFolder, reporter: Reporter = SILENT) -> None:
    """Perform a stage, unless its subfolder holds valid results."""
    reason = staleness(stage, output.root)
    if not reason:
        reporter.note(stage.name, "nothing changed, reused")
        return
    if (output.root / stage.name).exists():
        reporter.note(stage.name, f"done again: {reason}")
    with reporter.work(stage.name, stage.doing, stage.unit) as advance:
        perform(stage, output, advance)


@dataclass(frozen=True)
class RunFigures:
    """Figures of a run by name: design, parts, and calibration against the ground truth."""

    design: Mapping[str, Metric]
    parts: Mapping[str, Metric]
    validation: Mapping[str, Metric]

    @property
    def passed(self) -> bool:
        """True if every figure is within its limit."""
        return all(
            metric.passed for metrics in (self.design, self.parts, self.validation) for metric in metrics.values()
        )


def run_all(
    recipe: Recipe, root: Path, command: str, reporter: Reporter = SILENT, *, force: bool = False
) -> RunFigures:
    """Perform the stages whose results in `root` are missing or stale, then write `metrics.json` and `index.html`.

    The page states `command`. Raises InputError before any work if an extra is missing and, without `force`, if a file
    to replace was not written by a run or was changed since.
    """
    require("cad", "render")
    with output_folder(root, "run", force=force) as output:
        output.refuse_others("metrics.json", "index.html")
        planned = stages(recipe, root)
        refuse_foreign(planned, output)
        for number, stage in enumerate(planned, 1):
            finish(replace(stage, doing=f"step {number} of {len(planned)}, {stage.doing}"), output, reporter)
        figures = _figures(root)
        groups = {"design": figures.design, "cad": figures.parts, "validation": figures.validation}
        with output.staged(result="metrics.json") as folder:
            write_metrics(
                folder / "metrics.json",
                {f"{stage}.{name}": metric for stage, metrics in groups.items() for name, metric in metrics.items()},
            )
            write_page(root, folder / "index.html", command=command, small=recipe.small)
    return figures


def _figures(root: Path) -> RunFigures:
    """Read the figures written by the stages of a run."""
    return RunFigures(
        Layout.load(root / "design" / "layout.json").metrics,
        read_metrics(root / "cad" / "checks.json"),
        read_metrics(root / "validation" / "metrics.json"),
    )
