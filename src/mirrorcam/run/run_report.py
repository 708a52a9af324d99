"""The page that `mirrorcam run` ends with: one HTML file beside its pictures, which works from disk and offline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mirrorcam.core.figures.figure_texts import TIMES, label_text, number_word, sentence_case, value_text, values_text
from mirrorcam.core.html.templates import FigureTable, PageFile, PagePicture, Table, Tile, render
from mirrorcam.core.values import Metric
from mirrorcam.optics.design.assess.focus import out_of_focus
from mirrorcam.optics.geometry.layout import Layout

TEMPLATES = Path(__file__).parent
HEADLINES = {
    "normal_error_max_deg": "is how far the worst mirror's calibrated direction is from the truth",
    "decoded_corner_rms_px": "is the RMS distance of decoded corners from where true positions predict them",
}


@dataclass(frozen=True)
class Report:
    """Content of the page. Paths are relative to it, with forward slashes."""

    command: str
    small: bool
    parabola: Layout
    layout: Layout
    view_size_px: tuple[int, int]
    frames: int
    base_frames: int
    as_built: str
    checks: Mapping[str, Metric]
    truth: Mapping[str, Metric]
    before_after: PagePicture
    focus: PagePicture | None
    part: PagePicture
    frame: PagePicture
    views: PagePicture
    residuals: PagePicture
    part_files: tuple[PageFile, ...]
    files: tuple[PageFile, ...]

    @property
    def limited(self) -> dict[str, Metric]:
        """Figures that have a limit, of the part and against the truth."""
        return {name: metric for name, metric in {**self.checks, **self.truth}.items() if metric.limit is not None}

    @property
    def out_of_focus(self) -> str:
        """What to do about circles of confusion past their limit; nothing where none is."""
        return out_of_focus(self.layout)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the figures past their limits."""
        return tuple(name for name, metric in self.limited.items() if not metric.passed)


def design_table(parabola: Layout, optimised: Layout) -> Table:
    """The figures of the optimised layout beside those of the parabola."""
    rows = []
    for name, metric in optimised.metrics.items():
        before = parabola.metrics.get(name)
        texts = values_text([before, metric]) if before else ["", value_text(metric)]
        rows.append((sentence_case(label_text(name)), *texts))
    return Table(("Figure", "Parabola", "Optimised"), rows)


def highlights(report: Report) -> list[Tile]:
    """Headline figures for a newcomer, of those that were measured."""
    width, height = report.view_size_px
    tiles = [Tile(report.layout.arrangement.text.replace("x", TIMES), f"views of {width} {TIMES} {height} px")]
    # A camera with an aperture can use only pixels whose whole pupil a mirror serves.
    counted, what = "pixel_efficiency_", "of the sensor"
    if report.layout.camera.aperture_mm > 0.0:
        counted, what = "usable_efficiency_", "of the sensor, usable by the whole lens,"
    for name, metric in report.layout.metrics.items():
        if name.startswith(counted) and metric.known:
            before = report.parabola.metrics.get(name)
            versus = f", parabola {before.value:.0%}" if before and before.known else ""
            depth = name.removeprefix(counted).replace("mm", " mm")
            tiles.append(Tile(f"{metric.value:.0%}", f"{what} shows the common scene at {depth}{versus}"))
    for name, text in HEADLINES.items():
        if name in report.truth and report.truth[name].known:
            tiles.append(Tile(value_text(report.truth[name], digits=2), text))
    return tiles


def verdict_text(report: Report) -> str:
    """Verdict in words: all checks pass, or the ones that fail."""
    count = len(report.limited)
    if not report.failed:
        return f"All {count} checks pass"
    names = ", ".join(sentence_case(label_text(name)) for name in report.failed)
    return f"{len(report.failed)} of {count} checks failed: {names}"


def index_html(report: Report) -> str:
    """The page. Every text that comes from outside is escaped."""
    camera = report.layout.camera
    mirrors = number_word(len(report.layout.mirrors))
    return render(
        TEMPLATES,
        "run_page.html",
        title=f"MirrorCam: a webcam and {mirrors} mirrors",
        report=report,
        mirrors=mirrors,
        camera=f"{camera.name}, {camera.width_px} {TIMES} {camera.height_px} px",
        verdict=verdict_text(report),
        highlights=highlights(report),
        design=design_table(report.parabola, report.layout),
        checks=FigureTable.of(report.checks),
        truth=FigureTable.of(report.truth),
    )
