"""The live page in a real browser: pictures move, the slider focuses, nothing is fetched from elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import pytest

from mirrorcam.optics.geometry.layout import Layout
from tests.mirrorcam.studio.browser import NARROW, WIDE, browser_page, served
from tests.mirrorcam.workflow.live_sets import repeated, write_live_set

LONG_MS = 60_000


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> Iterator[str]:
    """The address of a live page on a video of minutes."""
    folder = tmp_path_factory.mktemp("live_page")
    layout, video = write_live_set(folder, default_layout, frames=25)
    repeated(video, folder / "long.mkv", 400)
    small = ("--view-width-px", "100", "--depth-width-px", "80")
    with served(folder / "out", "live", str(folder / "long.mkv"), "--layout", str(layout), *small) as address:
        yield address


def moved(page: Any, kind: str) -> None:
    """Wait until another picture of a kind is drawn."""
    page.wait_for_selector(f"#{kind}[data-serial]", timeout=LONG_MS)
    serial = page.get_attribute(f"#{kind}", "data-serial")
    page.wait_for_selector(f"#{kind}:not([data-serial='{serial}'])", timeout=LONG_MS)


@pytest.mark.parametrize(("size", "scheme"), [(WIDE, "light"), (NARROW, "dark")])
def test_pictures_move_and_nothing_else_does(
    browser: Any, address: str, size: tuple[int, int], scheme: Literal["light", "dark"]
) -> None:
    with browser_page(browser, size, scheme) as watched:
        watched.open(address)
        for kind in ("frame", "views", "refocus", "depth"):
            moved(watched.page, kind)
        watched.page.wait_for_selector("#sharpness div:nth-child(9) span:has-text('%')", timeout=LONG_MS)
        assert watched.errors == [] and watched.outside == []
        assert sum(shift[0] for shift in watched.shifts()) < 0.01
        assert watched.page.evaluate("document.documentElement.scrollWidth") <= size[0]
        assert "pictures/s" in watched.status


@pytest.mark.parametrize(("size", "scheme"), [(WIDE, "light"), (WIDE, "dark"), (NARROW, "light"), (NARROW, "dark")])
def test_everything_is_accessible(
    browser: Any, address: str, size: tuple[int, int], scheme: Literal["light", "dark"]
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with browser_page(browser, size, scheme) as watched:
        watched.open(address)
        watched.page.check("#align")
        watched.page.wait_for_selector("#tilts td", timeout=LONG_MS)
        found = axe.Axe().run(watched.page).response["violations"]
        assert [(each["id"], [node["html"][:120] for node in each["nodes"][:3]]) for each in found] == []


def test_orders_from_the_page(browser: Any, address: str) -> None:
    with browser_page(browser) as watched:
        watched.open(address)
        page = watched.page
        moved(page, "refocus")
        page.focus("#focus")
        before = page.inner_text("#focus-text")
        page.keyboard.press("ArrowRight")
        assert page.inner_text("#focus-text") != before
        page.click("#record")
        page.wait_for_selector("#record.on", timeout=LONG_MS)
        page.click("#record")
        page.wait_for_selector("#record:not(.on)", timeout=LONG_MS)
        page.check("#align")
        page.wait_for_selector("#tilts td", timeout=LONG_MS)
        assert page.locator("#tilts tbody tr").count() == 9
        assert watched.errors == [] and watched.outside == []
