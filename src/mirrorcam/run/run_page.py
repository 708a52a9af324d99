"""The page of a run: one HTML file with its pictures, readable from disk and offline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import RootModel

from mirrorcam.calibration.error_bounds import bound_name
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_model, write_text
from mirrorcam.core.figures.figure_texts import (
    SIGMA,
    TIMES,
    label_text,
    number_word,
    sentence_case,
    value_text,
    values_text,
)
from mirrorcam.core.html.templates import FigureTable, PageFile, PagePicture, Table, Tile, full_stop, render
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import Metric
from mirrorcam.optics.design.assess.focus import out_of_focus
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.dataset import Dataset
from mirrorcam.render_scenes.settings import SensorModel

TEMPLATES = Path(__file__).parent
HEADLINES = {
    "normal_error_between_mirrors_max_deg": (
        "is the largest angle between a calibrated and a true mirror normal, without the rotation common to all"
    ),
    "decoded_corner_rms_px": "is the RMS distance of decoded corners from those predicted by the true positions",
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
    sensor: str
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
        """Figures with a limit: of the parts, and against the ground truth."""
        return {name: metric for name, metric in {**self.checks, **self.truth}.items() if metric.limit is not None}

    @property
    def out_of_focus(self) -> str:
        """Advice on circles of confusion that exceed their limit; empty if none does."""
        return out_of_focus(self.layout)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the figures that exceed their limits."""
        return tuple(name for name, metric in self.limited.items() if not metric.passed)


def design_table(parabola: Layout, optimised: Layout) -> Table:
    """Return the figures of the optimised layout next to the parabola's."""
    rows = []
    for name, metric in optimised.metrics.items():
        before = parabola.metrics.get(name)
        texts = values_text([before, metric]) if before else ["", value_text(metric)]
        rows.append((sentence_case(label_text(name)), *texts))
    return Table(("Figure", "Parabola", "Optimised"), rows)


def highlights(report: Report) -> list[Tile]:
    """Return the headline figures that were measured."""
    width, height = report.view_size_px
    tiles = [Tile(report.layout.arrangement.text.replace("x", TIMES), f"views of {width} {TIMES} {height} px")]
    # A camera with an aperture can use only unvignetted pixels.
    prefix, subject = "pixel_efficiency_", "of the sensor"
    if report.layout.camera.aperture_mm > 0.0:
        prefix, subject = "usable_efficiency_", "of the sensor, unvignetted,"
    for name, metric in report.layout.metrics.items():
        if name.startswith(prefix) and metric.known:
            before = report.parabola.metrics.get(name)
            versus = f", parabola {before.value:.0%}" if before and before.known else ""
            depth = name.removeprefix(prefix).replace("mm", " mm")
            tiles.append(Tile(f"{metric.value:.0%}", f"{subject} shows the common scene at {depth}{versus}"))
    for name, text in HEADLINES.items():
        if name in report.truth and report.truth[name].known:
            tiles.append(Tile(value_text(report.truth[name], digits=2), text + _bound_text(report.truth, name)))
    return tiles


def _bound_text(metrics: Mapping[str, Metric], name: str) -> str:
    """State the limit of a figure, and the bound from which it was set."""
    bound, limit = metrics.get(bound_name(name)), metrics[name].limit
    if bound is None or limit is None:
        return ""
    return f"; stated {SIGMA}: {value_text(bound, digits=2)}, limit: {value_text(bound, limit, 2)}"


def sensor_text(sensor: SensorModel) -> str:
    """Say what of a real lens and sensor the pictures have; empty for an ideal one."""
    lens = {
        f"waves of {sensor.lens_waves_px:g} px beyond its model": sensor.lens_waves_px,
        "a pupil that walks with the angle": sensor.pupil_walk_mm,
        "colour fringes": sensor.lateral_chromatic_percent,
    }
    camera = {
        "a colour mosaic": sensor.bayer,
        "noise": sensor.read_noise_grey or sensor.full_well_electrons,
        "noise reduction": sensor.denoising_grey,
        "a tone curve": sensor.tone_curve != "linear",
        "sharpening": sensor.sharpening,
        "JPEG compression": sensor.jpeg_quality,
    }
    parts = [
        f"{owner} {', '.join(name for name, present in effects.items() if present)}"
        for owner, effects in (("the lens has", lens), ("the camera adds", camera))
        if any(effects.values())
    ]
    return full_stop("; ".join(parts)) if parts else ""


def verdict_text(report: Report) -> str:
    """Return the verdict in words, with the names of the failed checks."""
    count = len(report.limited)
    if not report.failed:
        return f"All {count} checks pass"
    names = ", ".join(sentence_case(label_text(name)) for name in report.failed)
    return f"{len(report.failed)} of {count} checks failed: {names}"


def index_html(report: Report) -> str:
    """Render the page; external text is escaped."""
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


PICTURE_WIDTH_PX = 1600


class _Metrics(RootModel[dict[str, Metric]]):
    """Content of `metrics.json`."""


def read_metrics(path: Path) -> dict[str, Metric]:
    """Read `metrics.json`; raise InputError if it is invalid."""
    return read_model(_Metrics, path, LARGEST_LAYOUT_BYTES).root


def _limit_width(image: NDArray[np.uint8], width_px: int) -> NDArray[np.uint8]:
    height, width = image.shape[:2]
    if width <= width_px:
        return image
    size = (width_px, round(height * width_px / width))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def write_pictures(frame: Path, views: Path, out: Path) -> None:
    """Write frame.jpg and views.jpg in the size in which the page shows them."""
    for path, name in ((frame, "frame.jpg"), (views, "views.jpg")):
        write_image(out / name, _limit_width(read_image(path), PICTURE_WIDTH_PX))


def _picture(root: Path, path: str, opens: str, alt: str) -> PagePicture:
    height, width = read_image(root / path).shape[:2]
    return PagePicture(path=path, opens=opens, size_px=(width, height), alt=alt)


def _focus_picture(root: Path) -> PagePicture | None:
    """Return the picture of the depth of field; None for a pinhole."""
    if not (root / "design/focus.png").exists():
        return None
    return _picture(
        root,
        "design/focus.png",
        "design/focus.png",
        "Circles of confusion over depth via each mirror, as focused and with the best focus",
    )


def gather(root: Path, *, command: str, small: bool) -> Report:
    """Return the report of the finished stages in `root`."""
    layout = Layout.load(root / "design" / "layout.json")
    dataset = Dataset.load(root / "set")
    decoded = next((root / "light_field").glob("*.npz"))
    with np.load(decoded, allow_pickle=False) as light_field:
        height, width = light_field["weights"].shape[2:]
    frame = next(f"set/{name}" for name in dataset.frame_names if Path(name).stem == decoded.stem)
    views = f"light_field/{decoded.stem}_views.png"
    tolerances = dataset.tolerances
    return Report(
        command=command,
        small=small,
        parabola=Layout.load(root / "design" / "parabola.json"),
        layout=layout,
        view_size_px=(width, height),
        frames=dataset.frames,
        base_frames=dataset.base_frames,
        as_built=(
            f"each was tilted by {tolerances.tilt_deg:g}° and shifted by {tolerances.offset_mm:g} mm (one standard "
            f"deviation), and the lens deviates from its data sheet"
        ),
        sensor=sensor_text(dataset.settings.sensor),
        checks=read_metrics(root / "cad" / "checks.json"),
        truth=read_metrics(root / "validation" / "metrics.json"),
        before_after=_picture(
            root,
            "design/before_after.png",
            "design/before_after.png",
            "Sub-images, virtual cameras and overlap of the faceted parabola, next to the optimised layout",
        ),
        focus=_focus_picture(root),
        part=_picture(
            root, "cad/pictures/light.png", "cad/index.html", "The device, and the light from its lens to the scene"
        ),
        frame=_picture(root, "page/frame.jpg", frame, "A rendered frame: the board in every mirror"),
        views=_picture(root, "page/views.jpg", views, "The decoded views side by side"),
        residuals=_picture(
            root,
            "validation/residuals.png",
            "validation/report.html",
            "Mean residuals as arrows over the sensor, by view, and the distribution of all residuals",
        ),
        part_files=tuple(
            PageFile(f"cad/{name}", purpose)
            for name, purpose in (
                ("index.html", "all parts in 3-D, their files, drawings and checks"),
                ("guide.md", "how to print, cut and assemble them"),
                ("bom.md", "what to print, cut and buy"),
                ("assembly.step", "the device, for any CAD program"),
            )
        ),
        files=(
            PageFile("design/layout.json", "the design: camera and mirrors"),
            PageFile("validation/layout.json", "the calibrated layout, with its uncertainty"),
            PageFile("validation/report.html", "how well the calibration fits, its uncertainty, and its checks"),
            PageFile("metrics.json", "every figure on this page, with its unit and limit"),
            PageFile("set/dataset.json", "the synthetic set; its ground truth is in set/truth"),
            PageFile(decoded.relative_to(root).as_posix(), "one light field: samples, weights, view positions"),
        ),
    )


def write_page(root: Path, path: Path, *, command: str, small: bool) -> None:
    """Write the page of the run in `root`, with links to its files."""
    write_text(path, index_html(gather(root, command=command, small=small)))
