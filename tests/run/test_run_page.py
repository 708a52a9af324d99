"""The page of a run: what it gathers from the folders of the stages, and what it shows."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import SIGMA, TIMES
from mirrorcam.core.html.templates import PageFile, PagePicture
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.run.run_page import (
    PICTURE_WIDTH_PX,
    Report,
    gather,
    highlights,
    index_html,
    read_metrics,
    write_page,
    write_pictures,
)
from tests.render_scenes.manifests import dataset_of_two_frames

CHECKS = {"seat_error_mm": Metric(value=0.0001, unit="mm", limit=0.001)}
TRUTH = {"normal_error_max_deg": Metric(value=0.004, unit="deg", limit=0.02)}


@pytest.fixture
def root(small_layout: Layout, tmp_path: Path) -> Path:
    """The folder of a run of three frames, the second of which was decoded, in small pictures of unlike sizes."""
    small_layout.save(tmp_path / "design/layout.json")
    small_layout.save(tmp_path / "design/parabola.json")
    dataset = dataset_of_two_frames().replaced(
        layout_identity=small_layout.identity,
        frames=3,
        base_frames=2,
        tolerances=Tolerances(tilt_deg=0.7, offset_mm=0.25),
    )
    dataset.save(tmp_path / "set")
    (tmp_path / "light_field").mkdir()
    np.savez(tmp_path / "light_field/0001.npz", weights=np.zeros((1, 2, 30, 40), np.float32))
    write_metrics(tmp_path / "cad/checks.json", CHECKS)
    write_metrics(tmp_path / "validation/metrics.json", TRUTH)
    for number, name in enumerate(
        (
            "design/before_after.png",
            "design/focus.png",
            "cad/pictures/light.png",
            "validation/residuals.png",
            "page/frame.jpg",
        )
    ):
        write_image(tmp_path / name, np.zeros((20 + number, 60, 3), np.uint8))
    write_image(tmp_path / "page/views.jpg", np.zeros((50, 60, 3), np.uint8))
    return tmp_path


def test_the_report_holds_what_lies_in_the_folders(root: Path, small_layout: Layout) -> None:
    report = gather(root, command="mirrorcam run", small=True)
    assert (report.command, report.small) == ("mirrorcam run", True)
    assert report.layout == report.parabola == small_layout
    assert (report.frames, report.base_frames, report.view_size_px) == (3, 2, (40, 30))
    assert (report.checks, report.truth) == (CHECKS, TRUTH)
    assert "0.7°" in report.as_built
    assert "0.25 mm" in report.as_built
    assert report.focus is not None
    pictures = (report.before_after, report.focus, report.part, report.residuals, report.frame, report.views)
    assert [picture.size_px for picture in pictures] == [(60, height) for height in (20, 21, 22, 23, 24, 50)]
    suffix = RenderSettings().suffix
    assert report.frame.opens == f"set/frames/0001{suffix}"
    assert report.views.opens == "light_field/0001_views.png"


def test_the_page_shows_its_pictures_and_links_the_files_of_every_stage(root: Path) -> None:
    write_page(root, root / "index.html", command="mirrorcam run --seed 4", small=False)
    page = outline((root / "index.html").read_text(encoding="utf-8"))
    assert "mirrorcam run --seed 4" in page.text
    assert "All 2 checks pass" in page.text
    assert {"page/frame.jpg", "page/views.jpg", "cad/index.html", "light_field/0001.npz"} <= set(page.targets)
    folders = {target.split("/")[0] for target in page.targets if "/" in target}
    assert folders == {"design", "cad", "set", "validation", "light_field", "page"}


def test_pictures_are_no_larger_than_the_page_shows_them_and_keep_their_proportions(tmp_path: Path) -> None:
    write_image(tmp_path / "large.png", np.full((180, 2 * PICTURE_WIDTH_PX, 3), 90, np.uint8))
    write_image(tmp_path / "small.png", np.full((30, 40, 3), 90, np.uint8))
    write_pictures(tmp_path / "large.png", tmp_path / "small.png", tmp_path / "page")
    frame, views = (read_image(tmp_path / "page" / name) for name in ("frame.jpg", "views.jpg"))
    assert frame.shape == (90, PICTURE_WIDTH_PX, 3)
    assert views.shape == (30, 40, 3)
    assert abs(frame.astype(int) - 90).max() <= 1


def test_metrics_are_read_as_they_were_written(tmp_path: Path) -> None:
    write_metrics(tmp_path / "metrics.json", CHECKS | TRUTH)
    assert read_metrics(tmp_path / "metrics.json") == CHECKS | TRUTH


@pytest.mark.parametrize(
    ("text", "expected"),
    [('{"rms": {"value": "low", "unit": "px"}}', "rms.value"), ("{", "metrics.json: "), (None, "no such file")],
)
def test_metrics_that_are_none_are_refused_in_one_line(text: str | None, expected: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / "metrics.json").write_text(text)
    with pytest.raises(InputError) as refused:
        read_metrics(tmp_path / "metrics.json")
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)


VOID = {"meta", "img", "input", "link", "br"}


class Outline(HTMLParser):
    """Checks that tags nest, and collects links, pictures and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.targets: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.targets += [value or "" for name, value in attrs if name in ("href", "src")]

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:  # as of <img/>
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += data


def outline(page: str) -> Outline:
    parser = Outline()
    parser.feed(page)
    parser.close()
    assert parser.open == []
    return parser


@pytest.fixture
def report(small_layout: Layout) -> Report:
    figures = {
        "grid_error": Metric(value=0.4, unit="1"),
        "usable_efficiency_300mm": Metric(value=0.05, unit="of the sensor", lower_is_better=False),
        "pixel_efficiency_300mm": Metric(value=0.07, unit="of the sensor", lower_is_better=False),
    }
    better = {
        "grid_error": Metric(value=0.1, unit="1"),
        "pixel_efficiency_300mm": Metric(value=0.53, unit="of the sensor", lower_is_better=False),
        "usable_efficiency_300mm": Metric(value=0.46, unit="of the sensor", lower_is_better=False),
    }

    def picture(name: str) -> PagePicture:
        return PagePicture(path=f"page/{name}.jpg", opens=f"set/{name}.png", size_px=(1600, 900), alt=name)

    return Report(
        command="mirrorcam run --seed 0",
        small=False,
        parabola=small_layout.replaced(metrics=figures),
        layout=small_layout.replaced(metrics=better),
        view_size_px=(480, 270),
        frames=20,
        base_frames=10,
        as_built="each was tilted",
        sensor="The lens has colour fringes.",
        checks={"seat_error_mm": Metric(value=0.0001, unit="mm", limit=0.001)},
        truth={
            "normal_error_between_mirrors_max_deg": Metric(value=0.00412, unit="deg", limit=0.02),
            "normal_error_between_mirrors_max_bound_deg": Metric(value=0.0051, unit="deg"),
            "corners": Metric(value=40000, unit="1"),
        },
        before_after=picture("before_after"),
        focus=picture("focus"),
        part=picture("part"),
        frame=picture("frame"),
        views=picture("views"),
        residuals=picture("residuals"),
        part_files=(PageFile("cad/mirror_holder.step", "the solid"),),
        files=(PageFile("metrics.json", "every figure"),),
    )


def test_the_page_shows_figures_limits_pictures_and_files(report: Report) -> None:
    found = outline(index_html(report))
    for words in (
        "All 2 checks pass",
        "Worst mirror normal, without the rotation common to all mirrors",
        f"stated {SIGMA}: 0.0051°, limit: 0.02°",
        "The lens has colour fringes.",
        "0.00412°",
        "0.0041°",
        "≤ 0.02°",
        "46%",
        f"480 {TIMES} 270",
        "20 frames",
    ):
        assert words in found.text
    expected = {
        "page/before_after.jpg",
        "page/focus.jpg",
        "page/part.jpg",
        "page/frame.jpg",
        "page/views.jpg",
        "page/residuals.jpg",
        "set/frame.png",
    }
    assert expected | {"cad/mirror_holder.step", "metrics.json"} <= set(found.targets)


def test_tiles_count_the_pixels_that_the_camera_can_use(report: Report) -> None:
    pinhole = report.layout.replaced(camera=report.layout.camera.replaced(aperture_mm=0.0))
    for layout, share, before in ((report.layout, "46%", "5%"), (pinhole, "53%", "7%")):
        tiles = {tile.value: tile.text for tile in highlights(replace(report, layout=layout))}
        assert tiles[share].endswith(f"at 300 mm, parabola {before}")


def test_a_pinhole_has_no_picture_of_its_focus(report: Report) -> None:
    page = outline(index_html(replace(report, focus=None)))
    assert "page/focus.jpg" not in page.targets
    assert "pinhole" not in page.text


def test_the_page_needs_nothing_from_outside(report: Report) -> None:
    page = index_html(report)
    assert all(not re.match(r"[a-z]+:|/", target) for target in outline(page).targets)
    assert "<script" not in page
    assert "url(" not in page
    assert "@import" not in page


HOSTILE = "<img src=x onerror=alert(1)>\"'&"


def test_every_text_is_escaped(report: Report) -> None:
    camera = report.layout.camera.replaced(name=HOSTILE)
    hostile_figure = {HOSTILE: Metric(value=1.0, unit=HOSTILE, limit=0.5)}
    hostile = replace(
        report,
        command=HOSTILE,
        as_built=HOSTILE,
        layout=report.layout.replaced(camera=camera, metrics=hostile_figure),
        checks=hostile_figure,
        truth={HOSTILE: Metric(value=1.0, unit=HOSTILE)},
        frame=PagePicture(path=HOSTILE, opens=HOSTILE, size_px=(1, 1), alt=HOSTILE),
        files=(PageFile(HOSTILE, HOSTILE),),
    )
    page = index_html(hostile)
    found = outline(page)
    assert "<img src=x" not in page
    assert found.text.count("onerror=alert(1)") >= 10
    assert HOSTILE in found.targets


def test_a_figure_past_its_limit_is_named_first_and_fails_the_page(report: Report) -> None:
    worse = Metric(value=0.05, unit="deg", limit=0.02)
    page = index_html(replace(report, truth={"rms_x_px": Metric(value=0.05, unit="px", limit=0.1), "tilt": worse}))
    text = outline(page).text
    assert "1 of 3 checks failed: Tilt" in text
    assert "FAIL" in text
    table = page[page.index("Comparison with the ground truth") :]
    assert table.index("Tilt") < table.index("Reprojection error, RMS in x")
    assert "checks pass" not in text


def test_checks_of_the_part_are_folded_away_unless_one_fails(report: Report) -> None:
    page = index_html(report)
    assert "<details><summary>1 check passed" in page
    worse = {**report.checks, "wall_mm": Metric(value=0.4, unit="mm", limit=1.2, lower_is_better=False)}
    page = index_html(replace(report, checks=worse))
    assert "<details open><summary>1 of 2 checks failed</summary>" in page
