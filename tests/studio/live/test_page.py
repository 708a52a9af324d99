"""The tab of the camera in a real browser: pictures move, the slider focuses, nothing is fetched from elsewhere."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal
from urllib.request import urlopen

import pytest

from mirrorcam.optics.calibration.diagnostics.verdict import MIN_FRAMES
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.optics.geometry.layout import Layout
from tests.small_set import BOARD
from tests.studio.browser import NARROW, WIDE, browser_page, served
from tests.studio.live.live_sets import repeated, write_live_set

pytestmark = pytest.mark.slow

LONG_MS = 60_000


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> Iterator[str]:
    """The address of a live page on a video of minutes."""
    folder = tmp_path_factory.mktemp("live_page")
    layout, video = write_live_set(folder, default_layout, frames=25)
    repeated(video, folder / "long.mkv", 400)
    with served(folder / "out", "live", str(folder / "long.mkv"), "--layout", str(layout)) as address:
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
        assert "pictures/s" in watched.page.inner_text("#camera-status")


@pytest.mark.parametrize(("size", "scheme"), [(WIDE, "light"), (WIDE, "dark"), (NARROW, "light"), (NARROW, "dark")])
def test_everything_is_accessible(
    browser: Any, address: str, size: tuple[int, int], scheme: Literal["light", "dark"]
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with browser_page(browser, size, scheme) as watched:
        watched.open(address)
        # The page of the size before may have left the alignment on: wait for the state of the camera.
        watched.page.wait_for_selector("#camera-status:has-text('pictures/s')", timeout=LONG_MS)
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


WAITS = """
window.seen = { alignment: new Set(), "depth-text": new Set(), hint: new Set() };
addEventListener("DOMContentLoaded", () => {
  for (const [id, texts] of Object.entries(window.seen)) {
    const node = document.getElementById(id);
    if (!node) continue;
    const note = () => texts.add(node.textContent);
    new MutationObserver(note).observe(node, { childList: true, characterData: true, subtree: true });
    note();
  }
});
"""
"""Every text that some elements have had."""


def texts(page: Any, name: str) -> list[str]:
    """What an element has said since the page was opened, in order."""
    found: list[str] = page.evaluate(f"[...window.seen['{name}']]")
    return found


def get(address: str) -> Any:
    """The status of the server."""
    with urlopen(f"{address.split('#')[0]}state", timeout=10) as answer:
        return json.load(answer)["camera"]


def black(page: Any, kind: str) -> bool:
    """Whether nothing is drawn on the canvas of a kind."""
    drawn = f"Array.from(document.getElementById('{kind}').getContext('2d').getImageData(0, 0, 60, 60).data)"
    return not any(page.evaluate(drawn))


@pytest.fixture
def short(tmp_path: Path, default_layout: Layout) -> Iterator[str]:
    """The address of a live page on a video of a second, with a board."""
    layout, video = write_live_set(tmp_path, default_layout, frames=25)
    save_board(tmp_path / "board.toml", BOARD)
    board = ("--board", str(tmp_path / "board.toml"))
    with served(tmp_path / "out", "live", str(video), "--layout", str(layout), *board) as address:
        yield address


def test_a_video_begins_with_the_first_page_keeps_its_last_pictures_and_plays_again(browser: Any, short: str) -> None:
    time.sleep(2.0)
    before = get(short)
    assert before["frames"] == 0 and not before["over"]
    with browser_page(browser) as first:
        first.open(short)
        page = first.page
        page.wait_for_selector("#camera-status:has-text('has ended')", timeout=LONG_MS)
        for kind in ("frame", "views", "refocus", "depth"):
            page.wait_for_selector(f"#{kind}[data-serial]", timeout=LONG_MS)
        for button in ("record", "take"):
            assert page.is_disabled(f"#{button}") and "video.avi has ended" in page.get_attribute(f"#{button}", "title")
        frames = get(short)["frames"]
        assert frames > 0
    with browser_page(browser) as later:
        later.open(short)
        page = later.page
        for kind in ("frame", "views", "refocus", "depth"):
            page.wait_for_selector(f"#{kind}[data-serial]", timeout=LONG_MS)
            assert not black(page, kind)
        serial = page.get_attribute("#refocus", "data-serial")
        page.focus("#focus")
        page.keyboard.press("ArrowRight")
        page.wait_for_selector(f"#refocus:not([data-serial='{serial}'])", timeout=LONG_MS)
        assert get(short)["frames"] == frames
        page.click("#again:not([disabled])")
        page.wait_for_selector("#record:not([disabled])", timeout=LONG_MS)
        page.wait_for_selector("#record[disabled]", timeout=LONG_MS)
        assert get(short)["frames"] > frames
        assert later.errors == [] and later.outside == []


def requests_in(page: Any, ms: float) -> Counter[str]:
    """How often a page asks for what in a time."""
    asked: Counter[str] = Counter()

    def count(request: Any) -> None:
        asked[request.url.split("/", 3)[3].split("?")[0]] += 1

    page.on("request", count)
    page.wait_for_timeout(ms)
    page.remove_listener("request", count)
    return asked


def test_a_page_rests_after_the_end_until_something_is_ordered(browser: Any, short: str) -> None:
    with browser_page(browser) as first, browser_page(browser) as later:
        first.open(short)
        first.page.wait_for_selector("#ended:visible", timeout=LONG_MS)
        later.open(short)
        for kind in ("frame", "views", "refocus", "depth"):
            later.page.wait_for_selector(f"#{kind}[data-serial]", timeout=LONG_MS)
        later.page.wait_for_selector("#ended:has-text('video.avi has ended')", timeout=LONG_MS)
        end = time.monotonic() + LONG_MS / 1e3
        while set(requests_in(later.page, 4000)) - {"state"}:
            assert time.monotonic() < end
        asked = requests_in(later.page, 3000)
        assert set(asked) <= {"state"} and asked.total() <= 3
        serial = later.page.get_attribute("#refocus", "data-serial")
        later.page.focus("#focus")
        later.page.keyboard.press("ArrowRight")
        later.page.wait_for_selector(f"#refocus:not([data-serial='{serial}'])", timeout=LONG_MS)
        serial = later.page.get_attribute("#frame", "data-serial")
        first.page.click("#again:not([disabled])")
        later.page.wait_for_selector(f"#frame:not([data-serial='{serial}'])", timeout=LONG_MS)
        later.page.wait_for_selector("#ended:visible", timeout=LONG_MS)
        assert first.errors == [] and later.errors == [] and later.shifts() == []


def test_a_server_that_has_no_pictures_is_not_pressed_for_them(browser: Any, address: str) -> None:
    with browser_page(browser) as watched:
        watched.page.route("**/picture/**", lambda route: route.fulfill(status=204))
        watched.open(address)
        asked = requests_in(watched.page, 3000)
        assert all(0 < asked[f"picture/{kind}"] <= 5 for kind in ("frame", "views", "refocus", "depth"))


def test_a_source_that_plays_cannot_be_played_again(browser: Any, address: str) -> None:
    with browser_page(browser) as watched:
        watched.open(address)
        moved(watched.page, "frame")
        assert watched.page.is_disabled("#again")
        assert watched.page.get_attribute("#again", "title") == "long.mkv is playing"


def test_long_work_is_reported_from_its_start(browser: Any, tmp_path: Path, default_layout: Layout) -> None:
    layout, video = write_live_set(tmp_path, default_layout, frames=25)
    repeated(video, tmp_path / "long.mkv", 100)
    save_board(tmp_path / "board.toml", BOARD)
    board = ("--board", str(tmp_path / "board.toml"))
    given = (str(tmp_path / "long.mkv"), "--layout", str(layout), *board)
    with served(tmp_path / "out", "live", *given) as address, browser_page(browser) as watched:
        page = watched.page
        page.add_init_script(WAITS)
        watched.open(address)
        page.wait_for_selector("#depth[data-serial]", timeout=LONG_MS)
        page.wait_for_selector("#depth-text:has-text('a second')", timeout=LONG_MS)
        assert texts(page, "depth-text")[0] == "starting …"
        assert not any(text.startswith("0.0 a second, unknown") for text in texts(page, "depth-text"))

        page.check("#align")
        assert page.inner_text("#alignment").startswith("Measuring")
        page.wait_for_selector("#tilts td", timeout=LONG_MS)
        said = texts(page, "alignment")
        assert [text.split(" ")[0] for text in said[:3]] == ["Tick", "Measuring", "By"]
        page.uncheck("#align")
        page.check("#align")
        assert page.inner_text("#alignment").startswith("Measuring") and page.locator("#tilts td").count() == 0

        assert page.is_disabled("#calibrate")
        for number in range(1, MIN_FRAMES + 1):
            assert page.is_disabled("#calibrate") and "calibration needs" in page.get_attribute("#calibrate", "title")
            page.click("#take")
            page.wait_for_selector(f"#hint:has-text('Picture {number} is saved')", timeout=LONG_MS)
        page.wait_for_selector("#calibrate:not([disabled])", timeout=LONG_MS)
        page.wait_for_selector("#hint:has-text('mirrors show the board')", timeout=LONG_MS)
        said = texts(page, "hint")
        assert next(text for text in said if text.startswith("Picture 1 ")).endswith("finding the board in it …")
        assert watched.errors == [] and watched.outside == []


@pytest.mark.parametrize("size", [WIDE, NARROW])
def test_names_on_the_frame_can_be_read(browser: Any, address: str, size: tuple[int, int]) -> None:
    with browser_page(browser, size) as watched:
        watched.open(address)
        watched.page.wait_for_selector("#overlay rect[width]", state="attached", timeout=LONG_MS)
        sizes = watched.page.evaluate(
            "[...document.querySelectorAll('#overlay text')].map((t) => t.getBoundingClientRect().height)"
        )
        plates = watched.page.evaluate(
            "[...document.querySelectorAll('#overlay text')].map((t) => {"
            " const [a, b] = [t.getBoundingClientRect(), t.previousSibling.getBoundingClientRect()];"
            " return b.left <= a.left && a.right <= b.right && b.top <= a.top + 3 && a.bottom <= b.bottom + 3; })"
        )
        assert len(sizes) == 9 and min(sizes) >= 12.0 and all(plates)
