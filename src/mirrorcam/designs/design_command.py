"""`mirrorcam design`: optimisation of a layout for a specification."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, print_metrics, say
from mirrorcam.core.processes.worker_pool import in_two_processes
from mirrorcam.core.values import InputError, Metric, Value
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.tolerances import Tolerances

if TYPE_CHECKING:
    from mirrorcam.optics.design.assess.monte_carlo import Study
    from mirrorcam.optics.geometry.layout import Layout

GROUPS = {
    "overlap of the views": (
        *("grid_error", "pixel_efficiency", "overlap_iou", "whole_pupil", "usable_efficiency"),
        *("fov", "depth_nearest", "depth_farthest"),
    ),
    "depth": ("baseline", "disparity", "depth_resolution", "depth_sigma"),
    "mirrors": ("shortest", "longest", "smallest", "largest", "slab"),
}
"""Titles of the groups of the table, each with the prefixes of the names of its figures."""
FILES = ("layout.json", "parabola.json", "before_after.png", "focus.png", "tolerance.json", "tolerance.png")


class DesignOptions(Value):
    """Optimise a layout of mirrors and compare it with the faceted parabola."""

    request: tyro.conf.Positional[
        Annotated[Path | None, tyro.conf.arg(metavar="[design.toml]", help_behavior_hint="")]
    ] = Field(default=None, description="what to design, as `mirrorcam studio` saves it, instead of the options below")
    spec: Annotated[DesignSpec, tyro.conf.OmitArgPrefixes] = Field(default_factory=DesignSpec)
    tolerance: bool = Field(
        default=False,
        description="also simulate devices built with the tolerances below, and write the figures to expect of them: "
        "tolerance.json and tolerance.png",
    )
    tolerances: Annotated[Tolerances, tyro.conf.OmitArgPrefixes] = Field(default_factory=Tolerances.hobby)
    out: Path = Field(
        default=Path("output/design"),
        description="folder for layout.json, parabola.json, before_after.png and focus.png",
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.tolerance and self.tolerances != Tolerances.hobby():
            raise ValueError("tolerances are given, expected --tolerance with them")
        if self.request is not None and self.spec != DesignSpec():
            raise ValueError(f"{self.request} and options of the design: expected one of the two")
        return self


def run(options: DesignOptions) -> int:
    """Design, and print the figures beside those of the parabola, then what was checked and its limits."""
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.designs.design_request import read_request

    asked = options.spec if options.request is None else read_request(options.request)
    with (
        output_folder(options.out, "design", force=options.force) as output,
        in_two_processes(preload=["mirrorcam.optics.design.optimise"]) as calls,
    ):
        output.refuse_others(*FILES)
        from mirrorcam.designs.design_files import write_design
        from mirrorcam.optics.design.assess.focus import focus_figures, out_of_focus

        with output.staged(result="layout.json") as folder:
            with long_work("design", f"{asked.arrangement.text} mirrors"):
                found = write_design(asked, folder, calls)
            study, no_study = None, None
            if options.tolerance:
                try:
                    study = _study(found.optimised, options, folder)
                except InputError as error:  # the design stands without
                    no_study = error
    spec = found.optimised.spec
    if asked.fold_deg == "auto" and spec is not None:
        unlimited = "" if spec.camera.body_mm else ", which the camera, whose body is unknown, does not limit"
        say("design", f"best fold: {spec.fold_deg:g}°{unlimited}")
    columns = {} if found.parabola is None else {"parabola": found.parabola}
    columns["optimised"] = found.optimised
    focus = {name: focus_figures(layout) for name, layout in columns.items()}
    others = {
        column: {name: metric for name, metric in layout.metrics.items() if name not in focus[column]}
        for column, layout in columns.items()
    }
    print_metrics(others, GROUPS)
    if any(focus.values()):
        print_metrics(focus, {"focus of the camera": ("",)})
    print_metrics({name: layout.verdict for name, layout in columns.items()}, {"verdict": ("",)})
    if found.no_parabola:
        say("design", f"no faceted parabola to compare with: {found.no_parabola}")
    if remark := out_of_focus(found.optimised):
        say("design", remark)
    written = ", ".join(name for name in FILES[:4] if (options.out / name).exists())
    say("design", f"{written} written to {options.out}")
    if study is not None:
        print_tolerance(study)
        say("tolerance", f"{options.out / 'tolerance.json'} and {options.out / 'tolerance.png'} written")
    if no_study is not None:
        raise no_study
    return 0


def _study(layout: Layout, options: DesignOptions, folder: Path) -> Study:
    from mirrorcam.designs.tolerance import write_tolerance

    with long_work("tolerance", "devices as built"):
        return write_tolerance(layout, options.tolerances, folder)


def print_tolerance(study: Study) -> None:
    """Print three tables: figures at the tolerances, medians over accuracy, and the share of each tolerance."""
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
    if study.shares:
        say("tolerance", "causes of the deviations from the design (share of their mean square, one cause at a time):")
        print_metrics(
            {
                cause: {name: Metric(value=round(100.0 * share), unit="%") for name, share in shares.items()}
                for cause, shares in study.shares.items()
            }
        )
