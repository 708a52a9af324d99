"""The report of a design: one HTML file with its pictures, figures, checks and request."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.figures.figure_texts import NONE, label_text, sentence_case, value_text, values_text
from mirrorcam.core.html.templates import FigureTable, Table, Tile, render
from mirrorcam.designs.design_figure import before_after, focus_figure
from mirrorcam.designs.tolerance import tolerance_figure
from mirrorcam.optics.design.assess.monte_carlo import Study
from mirrorcam.optics.geometry.layout import Layout

TEMPLATES = Path(__file__).parent
HEADLINES = {
    "usable_efficiency": "of the sensor is usable",
    "grid_error": "grid error",
    "fov_x_deg": "horizontal field of view",
    "depth_sigma": "sigma of depth",
}


@dataclass(frozen=True)
class ReportPicture:
    """A picture of the report."""

    title: str
    alt: str
    base64: str


def design_pictures(layout: Layout, parabola: Layout | None, study: Study | None = None) -> list[ReportPicture]:
    """Draw sensor, mirrors and coverage; focus, unless the camera is a pinhole; with a study, devices as built."""
    depths_mm = sorted(layout.designed_spec.depths_mm)
    pictures = []
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "picture.png"

        def add(title: str, alt: str) -> None:
            pictures.append(ReportPicture(title, alt, base64.b64encode(read_bytes(path)).decode()))

        before_after(parabola, layout, path)
        add("Sensor, mirrors and coverage", "Sub-images, mirrors, virtual cameras and overlap next to the parabola's")
        if layout.camera.aperture_mm > 0.0:
            focus_figure(layout, depths_mm, path)
            add("Focus", "Circles of confusion over depth, as focused and with the best focus")
        if study is not None:
            tolerance_figure(study, path)
            add("Devices as built", "Figures of devices built with tolerances, against the accuracy of building")
    return pictures


def design_report(
    layout: Layout, parabola: Layout | None, pictures: Sequence[ReportPicture], *, not_built: str = ""
) -> str:
    """Render the page of a designed layout, compared with its faceted parabola.

    `not_built` is the reason why the picture of devices as built is missing; "" if it is not.
    """
    spec = layout.designed_spec
    checks = FigureTable.of(layout.verdict)
    count = len(layout.verdict)
    return render(
        TEMPLATES,
        "design_report.html",
        title=f"{layout.arrangement.text} views with a {layout.camera.name}",
        lead=f"{len(layout.mirrors)} flat mirrors, the central one {spec.scale_mm:g} mm above the lens, for scenes at "
        f"{', '.join(f'{depth:g}' for depth in sorted(spec.depths_mm))} mm.",
        verdict=f"{checks.failed} of {count} checks failed" if checks.failed else f"All {count} checks pass",
        tiles=_tiles(layout),
        pictures=pictures,
        not_built=not_built,
        figures=_figures(layout, parabola),
        checks=checks,
        request=_request(layout),
        identity=layout.identity,
    )


def _tiles(layout: Layout) -> list[Tile]:
    tiles = []
    for name, metric in layout.metrics.items():
        if name.startswith(tuple(HEADLINES)):
            label = label_text(name, HEADLINES)
            known = Tile(value_text(metric, digits=3), label)
            tiles.append(known if metric.known else Tile(NONE, f"{label}: {metric.reason}"))
    return tiles


def _figures(layout: Layout, parabola: Layout | None) -> Table:
    if parabola is None:
        rows = [(sentence_case(label_text(name)), value_text(metric)) for name, metric in layout.metrics.items()]
        return Table(("Figure", "This design"), rows, "words")
    both = []
    for name, metric in layout.metrics.items():
        reference = parabola.metrics.get(name)
        texts = values_text([metric, reference]) if reference else [value_text(metric), ""]
        both.append((sentence_case(label_text(name)), *texts))
    return Table(("Figure", "This design", "Faceted parabola"), both, "words")


def _request(layout: Layout) -> Table:
    fields = layout.designed_spec.model_dump(mode="json")
    fields |= {"camera": layout.camera.name}
    rows = [(name, ", ".join(map(str, v)) if isinstance(v, list) else str(v)) for name, v in fields.items()]
    return Table(("Field of design.toml", "Value"), rows)
