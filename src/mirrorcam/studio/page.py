"""The studio's page: one HTML file that contains its styles and scripts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.core.html.templates import render
from mirrorcam.core.values import Value
from mirrorcam.optics.design.spec_grid import Outcome, pareto_front, summary_figures
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.controls import ControlGroup, control_groups, snapping_groups


class SweepPoint(Value):
    """A solved design of a sweep: its request and the compared figures.

    `best` names the plots, "field" and "grid", in which no other design is better in both figures.
    """

    title: str
    spec: DesignSpec
    field_deg: float
    depth_per_m: float
    grid_error: float
    efficiency: float
    best: list[str]


def sweep_points(outcomes: Sequence[Outcome]) -> list[SweepPoint]:
    """Return the points of solved designs, in order; those without a figure, as with a single depth, are omitted."""
    points = []
    for outcome in outcomes:
        figures = summary_figures(outcome)
        field_deg, depth_per_m, efficiency = (
            figures[name] for name in ("fov_diagonal_deg", "depth_of_field_per_m", "pixel_efficiency_mean")
        )
        grid_error = outcome.metrics.get("grid_error")
        if field_deg is None or depth_per_m is None or efficiency is None or grid_error is None or not grid_error.known:
            continue
        spec = outcome.spec
        points.append(
            SweepPoint(
                title=f"{spec.arrangement.text}, {spec.scale_mm:g} mm, trade-off {spec.tradeoff:g}",
                spec=spec,
                field_deg=field_deg,
                depth_per_m=depth_per_m,
                grid_error=grid_error.value,
                efficiency=efficiency,
                best=[],
            )
        )
    fronts = {
        "field": pareto_front([(point.field_deg, point.depth_per_m) for point in points]),
        "grid": pareto_front([(-point.grid_error, point.efficiency) for point in points]),
    }
    return [
        point.replaced(best=[name for name, front in fronts.items() if number in front])
        for number, point in enumerate(points)
    ]


WEB = Path(__file__).parent / "web"
SCRIPTS = (
    "three.bundle.js",
    "dom.js",
    "spec.js",
    "panels.js",
    "scale.js",
    "view3d.js",
    "controls.js",
    "figures.js",
    "compare.js",
    "tolerance.js",
    "sweep.js",
)
SERVER_SCRIPTS = ("server.js", "sight.js", "make.js", "live_pictures.js", "live_meters.js", "live.js")


@dataclass(frozen=True)
class PageStart:
    """Initial content of the page: a request, and the designs of a sweep."""

    spec: DesignSpec
    sweep: tuple[SweepPoint, ...] = ()


def studio_page(page_start: PageStart, folder: Path, *, nonce: str) -> str:
    """Render the page of a server that writes into a folder; browsers run only scripts and styles with the nonce."""
    scripts = (*SCRIPTS, *SERVER_SCRIPTS, "main.js")
    return _page(page_start, control_groups(page_start.spec), scripts, nonce=nonce, makes_into=str(folder))


def snapshot_page(spec: DesignSpec, atlas: dict[str, Any]) -> str:
    """Render the page without a server: one file with the designs of an atlas, initially the nearest to `spec`."""
    scripts = (*SCRIPTS, "snapshot.js", "main.js")
    return _page(PageStart(spec), snapping_groups(atlas["axes"]), scripts, atlas=script_json(atlas))


def _page(page_start: PageStart, groups: Sequence[ControlGroup], scripts: Sequence[str], **blocks: Any) -> str:
    start = {
        "spec": page_start.spec.model_dump(mode="json"),
        "defaults": DesignSpec().model_dump(mode="json"),
        "optional": {name: getattr(DesignSpec(), name) for name in OPTIONAL},
        "controls": [group.model_dump(mode="json") for group in groups],
        "sweep": [point.model_dump(mode="json") for point in page_start.sweep],
    }
    adapters = {kind: table.title for kind, table in BACKS.items()}
    common = {"nonce": "", "makes_into": "", "atlas": "", "adapters": adapters}
    return render(WEB, "studio.html", start=script_json(start), scripts=scripts, **(common | blocks))


OPTIONAL = ("size_step_mm", "same_size")
"""Fields that the JSON of a request omits at their defaults."""


def script_json(value: Any) -> Markup:
    """Return JSON that is safe inside a script element."""
    return Markup(json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
