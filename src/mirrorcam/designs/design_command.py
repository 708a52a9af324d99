"""`mirrorcam design`: optimisation of a layout for a specification."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mirrorcam.core.bounds import DEPTH_MM, FOLD_DEG, LENGTH_MM, MIRRORS, Bounds
from mirrorcam.core.console.options import Force, bounded
from mirrorcam.core.console.progress import long_work, print_metrics, say
from mirrorcam.core.errors import InputError

if TYPE_CHECKING:
    from mirrorcam.core.values import Metric
    from mirrorcam.designs.design_files import DesignComparison
    from mirrorcam.designs.target_search import TargetDesigns
    from mirrorcam.optics.design.assess.monte_carlo import Study
    from mirrorcam.optics.geometry.design_spec import DesignSpec

GROUPS = {
    "overlap of the views": (
        *("grid_error", "pixel_efficiency", "overlap_iou", "whole_pupil", "usable_efficiency"),
        *("fov", "depth_nearest", "depth_farthest"),
    ),
    "depth": ("baseline", "disparity", "depth_resolution", "depth_sigma"),
    "mirrors": ("shortest", "longest", "smallest", "largest", "slab"),
}
"""Groups of the table by title, each with the prefixes of its figures' names."""
FILES = ("layout.json", "parabola.json", "before_after.png", "focus.png", "tolerance.json", "tolerance.png")


@Parameter(name="*")
@dataclass(frozen=True)
class DesignChanges:
    """Fields of a design's specification that options replace; None keeps a field."""

    camera: Annotated[
        str | None,
        Parameter(metavar="NAME|FILE", help="name of `mirrorcam camera list`, or a TOML or JSON file [default: c920]"),
    ] = None
    rows: Annotated[int | None, bounded(MIRRORS, "rows of mirrors, one row of views each", unset="3")] = None
    cols: Annotated[int | None, bounded(MIRRORS, "columns of mirrors", unset="3")] = None
    pattern: Annotated[
        str | None,
        Parameter(
            metavar="hexN|ringN|FILE",
            help="positions of the views instead of rows and columns: hex7, hex19, ring8 or a JSON or TOML file",
        ),
    ] = None
    scale_mm: Annotated[
        float | None,
        bounded(LENGTH_MM, "distance from the pupil to the central mirror, along the optical axis", unset="80"),
    ] = None
    fold_deg: Annotated[
        float | Literal["auto"] | None,
        bounded(
            FOLD_DEG, "angle from the camera's axis to the views' axis, auto: the best integer degree", unset="120"
        ),
    ] = None
    depths_mm: Annotated[
        tuple[float, ...] | None,
        bounded(DEPTH_MM, "scene depths at which the views overlap, from the pupil, up to 10", unset="300 500"),
    ] = None
    tradeoff: Annotated[
        float | None,
        bounded(Bounds(0.0, 1.0), "weight of a regular grid of views against usable pixels", unset="0.3"),
    ] = None
    mirror: Annotated[
        str | None,
        Parameter(
            metavar="SURFACE-MATERIAL-MM",
            help="stock of the mirrors: first-glass-3, second-glass-2, second-acrylic-3, first-acrylic-1 or any other "
            "thickness [default: first-glass-3]",
        ),
    ] = None
    shape: Annotated[
        str | None,
        Parameter(
            metavar="rectangles|stock:AxB,...|free",
            help="outlines of the mirrors: rectangles with sides in steps of size_step_mm, sizes in mm that are sold, "
            "such as stock:25x15,30x20, or free [default: rectangles]",
        ),
    ] = None
    same_size: Annotated[bool | None, Parameter(help="give all rectangles one size")] = None
    size_step_mm: Annotated[
        float | None, bounded(LENGTH_MM, "step of the sides of rectangles that are cut", unset="1")
    ] = None

    def of(self, spec: DesignSpec) -> DesignSpec:
        """The specification with these fields replaced; raises InputError if they contradict the others."""
        from mirrorcam.core.disk.files import read_model
        from mirrorcam.optics.geometry.arrangement import Pattern
        from mirrorcam.optics.geometry.camera_library import read_camera
        from mirrorcam.optics.geometry.mirror_stock import stock_fields

        changes: dict[str, Any] = {name: value for name, value in vars(self).items() if value is not None}
        if self.mirror is not None:
            changes |= stock_fields(changes.pop("mirror"))
        if self.camera is not None:
            changes["camera"] = read_camera(self.camera)
        if self.pattern is not None:
            changes["pattern"] = Pattern.named(self.pattern) or read_model(Pattern, Path(self.pattern))
        return spec.replaced(**changes)


def design(
    request: Annotated[
        Path | None,
        Parameter(name="DESIGN", help="design.toml with all fields of the design (docs/design.md), or a layout.json"),
    ] = None,
    /,
    *,
    changes: DesignChanges = DesignChanges(),
    target: Annotated[
        tuple[str, ...] | None,
        Parameter(
            metavar="TERM...",
            help="find the numbers of mirrors, the scale and the fold for a task. Terms: standard deviation of depth "
            "(0.3mm@400mm), field common to all views (150x120mm@400mm), mass (300g), printing time (8h), price "
            "(90EUR, or 60EUR+camera), largest side (180mm)",
        ),
    ] = None,
    tolerance: Annotated[
        bool, Parameter(help="also simulate devices with the tolerances of design.toml, else of assembly by hand")
    ] = False,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/design"),
    force: Force = False,
) -> int:
    """Optimise a layout of mirrors.

    Writes layout.json, parabola.json (the design of 2016, for comparison), before_after.png and focus.png;
    with --tolerance, tolerance.json and tolerance.png. Options replace the fields of design.toml.

    With --target, the search chooses rows, columns, scale, fold and working depths, unless an option or design.toml
    states them; if no design meets all terms, also the mirrors, unless stated. It prints the smallest designs that meet
    all terms, or the nearest and the terms that they miss, and writes the best. Exit code 1: no design meets all terms.
    Figures of the device are estimates.

    Examples:
        mirrorcam design --rows 2 --cols 4 --scale-mm 60 --depths-mm 280 400
        mirrorcam design --mirror second-glass-3 --out output/glass
        mirrorcam design --mirror first-acrylic-1 --shape free --out output/laser
        mirrorcam design --shape stock:30x20 --fold-deg auto --out output/stock
        mirrorcam design design.toml --fold-deg auto --tolerance --out output/mine
        mirrorcam design --target 0.3mm@400mm 150x120mm@400mm 300g 8h --camera brio --out output/task
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.processes.worker_pool import in_two_processes
    from mirrorcam.designs.design_files import DesignRequest, read_request, write_design, write_layout
    from mirrorcam.designs.target import Target
    from mirrorcam.designs.target_search import MIRRORS, VARIED, designs_for

    requested = DesignRequest() if request is None else read_request(request)
    spec = changes.of(requested.spec)
    wanted = None if target is None else Target.of(target)
    answer = None
    with (
        output_folder(out, "design", force=force) as output,
        in_two_processes(preload=["mirrorcam.optics.design.optimise"]) as calls,
    ):
        output.refuse_others(*FILES)
        with output.staged(result="layout.json") as folder:
            if wanted is None:
                with long_work("design", f"{spec.arrangement.text} mirrors", "searches") as advance:
                    comparison = write_design(spec, folder, calls, advance)
            else:
                stated = requested.model_fields_set | {
                    name for name, value in vars(changes).items() if value is not None
                }
                if changes.mirror is not None:
                    stated |= set(MIRRORS)
                with long_work("design", f"for {wanted.text}", "steps") as advance:
                    answer = designs_for(wanted, spec, vary=set(VARIED) - stated, calls=calls, progress=advance)
                comparison = write_layout(answer.designs[0].layout, folder)
            study, tolerance_error = None, None
            if tolerance:
                from mirrorcam.designs.tolerance import write_tolerance

                try:
                    with long_work("tolerance", "devices as built"):
                        study = write_tolerance(comparison.optimised, requested.tolerances, folder)
                except InputError as error:  # the design is written without it
                    tolerance_error = error
    print_design(comparison, best_fold=spec.fold_deg == "auto")
    if answer is not None:
        print_target(answer)
    written = ", ".join(name for name in FILES[:4] if (out / name).exists())
    say("design", f"{written} written to {out}")
    if study is not None:
        print_tolerance(study)
        say("tolerance", f"{out / 'tolerance.json'} and {out / 'tolerance.png'} written")
    if tolerance_error is not None:
        raise tolerance_error
    return 0 if answer is None or answer.met else 1


def print_target(answer: TargetDesigns) -> None:
    """Print the figures of the designs for a target next to its terms, and the terms that give way."""
    from mirrorcam.core.console.progress import print_table
    from mirrorcam.optics.geometry.mirror_stock import mirrors_text

    specs = [design.layout.designed_spec for design in answer.designs]
    heads = [f"{s.arrangement.text}, {s.scale_mm:g} mm, {s.fold_deg:g}°" for s in specs]
    rows = [
        (
            term.text,
            *(f"{each.figure_text(term)}{' !' if term.text in each.gives_way else ''}" for each in answer.designs),
        )
        for term in answer.target.terms
    ]
    print_table(("target", *heads), rows)
    for head, design in zip(heads, answer.designs, strict=True):
        say("design", f"{head}: {mirrors_text(design.layout.designed_spec)}; {design.estimate.text}")
        if not design.meets:
            say("design", f"{head}: {', '.join(design.gives_way)} gives way")
    if answer.met:
        say("design", f"{heads[0]} is the smallest that meets the target")
    else:
        say("design", "no design was found that meets the target")


def print_design(comparison: DesignComparison, *, best_fold: bool) -> None:
    """Print figures of the layout next to the parabola's, then the checks and their limits.

    `best_fold` states that the optimiser chose the fold.
    """
    from mirrorcam.optics.design.assess.focus import focus_figures, out_of_focus
    from mirrorcam.optics.geometry.mirror_stock import too_narrow

    spec = comparison.optimised.designed_spec
    if best_fold:
        unlimited = "" if spec.camera.body_mm else ", not limited by the camera, whose body is unknown"
        say("design", f"best fold: {spec.fold_deg:g}°{unlimited}")
    columns = {} if comparison.parabola is None else {"parabola": comparison.parabola}
    columns["optimised"] = comparison.optimised
    focus = {name: focus_figures(layout) for name, layout in columns.items()}
    others = {
        column: {name: metric for name, metric in layout.metrics.items() if name not in focus[column]}
        for column, layout in columns.items()
    }
    print_metrics(others, GROUPS)
    if any(focus.values()):
        print_metrics(focus, {"focus of the camera": ("",)})
    print_metrics({name: layout.verdict for name, layout in columns.items()}, {"verdict": ("",)})
    if comparison.no_parabola:
        say("design", f"no faceted parabola to compare with: {comparison.no_parabola}")
    for remark in (out_of_focus(comparison.optimised), too_narrow(comparison.optimised)):
        if remark:
            say("design", remark)


def print_tolerance(study: Study) -> None:
    """Print three tables: figures at the tolerances, medians by accuracy, and the share of each tolerance."""
    from mirrorcam.core.values import Metric
    from mirrorcam.designs.tolerance import hidden_mirrors, spread_columns

    say("tolerance", f"{study.devices} devices, standard deviations: {study.tolerances.workmanship}")
    columns: dict[str, dict[str, Metric]] = {}
    for name, spread in study.spreads[1.0].items():
        for column, metric in spread_columns(spread).items():
            columns.setdefault(column, {})[name] = metric
    columns["median"]["hidden_mirrors"] = hidden_mirrors(study, 1.0)
    print_metrics(columns)
    say("tolerance", "medians at multiples of these tolerances:")
    medians = {
        f"{accuracy:g}x": {name: Metric(value=s.median, unit=s.unit) for name, s in spreads.items()}
        | {"hidden_mirrors": hidden_mirrors(study, accuracy)}
        for accuracy, spreads in study.spreads.items()
    }
    print_metrics(medians)
    if study.cause_fractions:
        say("tolerance", "causes of the deviations from the design (share of their mean square, one cause at a time):")
        print_metrics(
            {
                cause: {name: Metric(value=round(100.0 * share), unit="%") for name, share in shares.items()}
                for cause, shares in study.cause_fractions.items()
            }
        )
