"""`mirrorcam design`: optimisation of a layout for a specification."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from pydantic import BeforeValidator, Field

from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, print_metrics, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.worker_pool import in_two_processes
from mirrorcam.core.values import Metric, Value
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.design_spec import FOLD_DEG, DesignSpec

if TYPE_CHECKING:
    from mirrorcam.designs.design_files import DesignComparison
    from mirrorcam.optics.design.assess.monte_carlo import Study

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


def pattern_from_text(text: str) -> Pattern:
    """A pattern of views by its name, such as hex7, or read from a JSON or TOML file."""
    from mirrorcam.core.disk.files import read_model

    return Pattern.named(text) or read_model(Pattern, Path(text))


def _field(name: str, unset: str = "") -> Any:
    """A field of `DesignSpec` as an option, None where it is not given; `unset` is its default, where it has one."""
    field = DesignSpec.model_fields[name]
    limits = {
        limit: getattr(bound, limit)
        for bound in field.metadata
        for limit in ("ge", "le", "min_length", "max_length")
        if hasattr(bound, limit)
    }
    default = f" [default: {unset}]" if unset else ""
    return Field(default=None, description=f"{field.description}{default}", **limits)


def _read(read: Any) -> BeforeValidator:
    return BeforeValidator(lambda value: read(value) if isinstance(value, str) else value)


@Parameter(name="*")
class DesignChanges(Value):
    """Fields of a design's specification that options replace; all others are those of `design.toml`."""

    camera: Annotated[
        Camera | None, Parameter(accepts_keys=False, n_tokens=1, metavar="NAME|FILE"), _read(read_camera)
    ] = _field("camera", "c920")
    rows: int | None = _field("rows", "3")
    cols: int | None = _field("cols", "3")
    pattern: Annotated[
        Pattern | None,
        Parameter(accepts_keys=False, n_tokens=1, metavar="hexN|ringN|FILE"),
        _read(pattern_from_text),
    ] = _field("pattern")
    scale_mm: float | None = _field("scale_mm", "80")
    fold_deg: Annotated[float, FOLD_DEG.each] | Literal["auto"] | None = _field("fold_deg", "120")
    depths_mm: tuple[Annotated[float, DEPTH_MM.each], ...] | None = _field("depths_mm", "300 500")
    tradeoff: float | None = _field("tradeoff", "0.3")

    def of(self, spec: DesignSpec) -> DesignSpec:
        """The specification with these fields; raises InputError where they do not fit the others."""
        return spec.replaced(**{name: getattr(self, name) for name in self.model_fields_set})


def design(
    request: Annotated[
        Path | None,
        Parameter(name="DESIGN", help="design.toml with all fields of the design (docs/design.md), or a layout.json"),
    ] = None,
    /,
    *,
    changes: DesignChanges = DesignChanges(),
    tolerance: Annotated[
        bool, Parameter(help="also simulate devices as built with the tolerances of design.toml, or made by hand")
    ] = False,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/design"),
    force: Force = False,
) -> int:
    """Optimise a layout of mirrors.

    Writes layout.json, parabola.json (the faceted parabola that it is compared with), before_after.png and focus.png;
    with --tolerance, tolerance.json and tolerance.png. Options replace the fields of design.toml.

    Examples:
        mirrorcam design --rows 2 --cols 4 --scale-mm 60 --depths-mm 280 400
        mirrorcam design design.toml --fold-deg auto --tolerance --out output/mine
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.designs.design_files import DesignRequest, read_request, write_design

    requested = DesignRequest() if request is None else read_request(request)
    spec = changes.of(requested.spec)
    with (
        output_folder(out, "design", force=force) as output,
        in_two_processes(preload=["mirrorcam.optics.design.optimise"]) as calls,
    ):
        output.refuse_others(*FILES)
        with output.staged(result="layout.json") as folder:
            with long_work("design", f"{spec.arrangement.text} mirrors"):
                found = write_design(spec, folder, calls)
            study, no_study = None, None
            if tolerance:
                from mirrorcam.designs.tolerance import write_tolerance

                try:
                    with long_work("tolerance", "devices as built"):
                        study = write_tolerance(found.optimised, requested.tolerances, folder)
                except InputError as error:  # the design stands without
                    no_study = error
    print_design(found, best_fold=spec.fold_deg == "auto")
    written = ", ".join(name for name in FILES[:4] if (out / name).exists())
    say("design", f"{written} written to {out}")
    if study is not None:
        print_tolerance(study)
        say("tolerance", f"{out / 'tolerance.json'} and {out / 'tolerance.png'} written")
    if no_study is not None:
        raise no_study
    return 0


def print_design(found: DesignComparison, *, best_fold: bool) -> None:
    """Print figures of the layout beside those of the parabola, then the checks and their limits.

    `best_fold`: the fold was to be chosen.
    """
    from mirrorcam.optics.design.assess.focus import focus_figures, out_of_focus

    spec = found.optimised.spec
    if best_fold and spec is not None:
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
