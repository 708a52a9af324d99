"""The page of a run shows what the folders of its stages hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import InputError, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.run.run_page import PICTURE_WIDTH_PX, gather, read_metrics, write_page, write_pictures
from tests.render_scenes.manifests import dataset_of_two_frames
from tests.run.test_run_report import outline

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
