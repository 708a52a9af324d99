"""What is made from the page: a job that is cancelled, the parts, and a design that goes the whole way."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.optics.geometry.layout import Layout
from tests.studio.browser import Watched, browser_page

pytestmark = pytest.mark.slow

SMALL = "#rows=1&cols=2&depths_mm=300"


@pytest.fixture
def page(browser: Any, studio: tuple[str, Path]) -> Iterator[Watched]:
    with browser_page(browser, accept_downloads=True) as watched:
        yield watched
        assert watched.errors == []
        assert watched.outside == []


def design_folder(studio: tuple[str, Path], page: Watched) -> Path:
    (found,) = (path for path in studio[1].iterdir() if path.name.endswith(page.drawn["identity"][:8]))
    return found


def ended(page: Watched, most_s: float) -> str:
    """How the newest job ends."""
    page.page.wait_for_selector("#jobs > li:first-child.running")
    job = page.page.wait_for_selector("#jobs > li:first-child:not(.running)", timeout=1e3 * most_s)
    return str(job.get_attribute("class")).split()[-1]


def test_a_job_is_followed_and_cancelled(page: Watched, studio: tuple[str, Path]) -> None:
    page.open(studio[0] + SMALL)
    page.settled()
    page.page.click("#build-tab")
    page.page.click("[data-make=set]")
    page.page.wait_for_selector(".job.running")
    page.page.click(".job >> text=Cancel")
    assert ended(page, 30.0) == "cancelled"
    folder = design_folder(studio, page)
    assert Layout.load(folder / "layout.json").identity == page.drawn["identity"]
    assert (folder / "design.toml").is_file()
    assert "mirrorcam render" in page.page.inner_text(".job summary")


def test_parts_are_built_for_the_carrier_that_is_chosen(page: Watched, studio: tuple[str, Path]) -> None:
    page.open(studio[0] + SMALL)
    page.settled()
    page.page.click("#build-tab")
    options = page.page.eval_on_selector_all("#adapter option", "found => found.map((each) => each.value)")
    assert options == list(BACKS)
    assert page.page.input_value("#adapter") == "none"
    page.page.get_by_label("The device stands on or is fastened to").select_option("vesa")
    page.page.click("[data-make=parts]")
    page.page.wait_for_selector(".job.running")
    page.page.click(".job >> text=Cancel")
    assert ended(page, 30.0) == "cancelled"
    assert "--adapter vesa" in page.page.inner_text(".job:first-child summary")


@pytest.mark.slow
def test_parts_are_built_shown_in_3d_and_downloaded(page: Watched, studio: tuple[str, Path], tmp_path: Path) -> None:
    pytest.importorskip("build123d")
    page.open(studio[0] + "#rows=2&cols=2")
    page.settled()
    page.page.click("#build-tab")
    page.page.click("[data-make=parts]")
    assert ended(page, 600.0) == "done"
    page.page.click("#design-tab")
    page.page.wait_for_selector("#built-option:not([hidden])", state="attached")
    page.page.wait_for_function("() => Studio.view.layers.get('device')")
    page.page.evaluate("Studio.designer.history.set({ cols: 3 })")
    page.page.wait_for_selector("#built-option", state="hidden")
    page.page.click("#undo")
    page.page.wait_for_selector("#built-option:not([hidden])", state="attached")
    page.page.click("#build-tab")
    with page.page.expect_download() as download:
        page.page.click(".job >> text=ZIP")
    download.value.save_as(tmp_path / "parts.zip")
    with zipfile.ZipFile(tmp_path / "parts.zip") as archive:
        names = archive.namelist()
    assert any(name.endswith("index.html") for name in names)
    assert any(name.endswith(".3mf") for name in names)
    with page.page.context.expect_page() as opened:
        page.page.click(".job >> text=Open")
    device = opened.value
    device.wait_for_selector("#stage[data-ready]", timeout=60_000)
    assert "2 by 2 cameras" in device.inner_text("header")


@pytest.mark.slow
def test_a_design_goes_the_whole_way_from_the_page(page: Watched, studio: tuple[str, Path]) -> None:
    pytest.importorskip("mitsuba")
    page.open(studio[0] + "#rows=2&cols=2&scale_mm=70")
    page.settled()
    page.page.click("#build-tab")
    page.page.click("[data-make=run]")
    # The command ends with 0 only where every figure of the parts and against the truth is within its limit.
    assert ended(page, 900.0) == "done", page.page.evaluate("document.querySelector('.job pre').textContent")
    folder = design_folder(studio, page) / "run"
    assert (folder / "index.html").is_file()
    assert (folder / "light_field").is_dir()
    assert Layout.load(folder / "validation" / "layout.json").kind == "calibrated"
    assert Layout.load(folder / "design" / "layout.json").identity == page.drawn["identity"]
