"""The studio's page in a real browser: drag, release, undo, address, refusal, comparison, and without a server."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import pytest

from mirrorcam.designs.design_files import read_request
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.atlas import AtlasGrid, atlas
from mirrorcam.studio.page import script_json, snapshot_page, studio_page
from tests.shared import built_once
from tests.studio.browser import NARROW, WIDE, Watched, browser_page

pytestmark = pytest.mark.slow

SMALL = "#rows=1&cols=2&depths_mm=300"
"""A design that is solved in half a second."""


@pytest.fixture
def page(browser: Any, studio: tuple[str, Path]) -> Any:
    with browser_page(browser, accept_downloads=True) as watched:
        yield watched
        assert watched.errors == []
        assert watched.outside == []


def opened(page: Watched, studio: tuple[str, Path], address: str = SMALL) -> None:
    page.open(studio[0] + address)
    page.settled()


def test_it_opens_with_the_exact_design_of_its_address(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    assert page.status.startswith("Exact: all")
    assert page.drawn["kind"] == "exact"
    assert len(page.drawn["mirrors"]) == 2
    assert page.page.locator("#sensor path.mirror").count() == 2
    assert page.page.locator("#stage canvas").is_visible()
    for drawing in ("#coverage", "#cameras"):
        assert page.page.locator(f"{drawing} path.measure").count() == 1
        assert " mm" in page.page.inner_html(f"{drawing} text.tick")
    assert "Price with the camera" in page.page.inner_text("#figures")


def test_two_pages_solve_at_the_same_time(browser: Any, studio: tuple[str, Path]) -> None:
    with browser_page(browser) as first, browser_page(browser) as second:
        pages = {91: first, 92: second}
        for scale_mm, page in pages.items():
            page.page.goto(f"{studio[0]}{SMALL}&scale_mm={scale_mm}", wait_until="commit")
        for scale_mm, page in pages.items():
            page.settled()
            assert page.drawn["kind"] == "exact" and page.drawn["spec"]["scale_mm"] == scale_mm
            page.page.wait_for_selector("#tolerance:not(.old) *", timeout=120_000)
            page.page.wait_for_selector("#sight-refocused:not(.old)", timeout=120_000)
            assert page.errors == []


def test_a_preview_follows_the_slider_and_the_exact_design_its_release(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    before = page.drawn["identity"]
    # As a pointer moves it: many inputs, one change at the end.
    page.page.evaluate(
        """() => {
      const range = document.querySelector('[data-name="scale_mm"] input[type=range]');
      range.value = Math.log(95);
      range.dispatchEvent(new Event("input", { bubbles: true }));
    }"""
    )
    page.page.wait_for_selector("#status.preview")
    assert page.drawn["kind"] != "exact"
    assert page.drawn["spec"]["scale_mm"] == 95.0
    page.page.dispatch_event("[data-name=scale_mm] input[type=range]", "change")
    page.page.wait_for_selector("#status.exact")
    assert page.drawn["kind"] == "exact"
    assert page.drawn["spec"]["scale_mm"] == 95.0
    assert page.drawn["identity"] != before
    assert "scale_mm=95" in page.page.url
    page.page.click("#undo")
    page.page.wait_for_selector("#status.exact")
    assert page.drawn["identity"] == before
    page.page.click("#redo")
    page.page.wait_for_selector("#status.exact")
    assert page.drawn["spec"]["scale_mm"] == 95.0


def typed(page: Watched, name: str, value: str) -> None:
    page.page.get_by_role("spinbutton", name=f"{name}, number").fill(value)
    page.page.keyboard.press("Enter")


def test_a_typed_number_is_previewed_and_its_solution_can_be_cancelled(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    page.page.route("**/design", lambda route: None)  # it takes forever
    typed(page, "Scale", "96")
    page.page.wait_for_selector("#status.preview:has-text('solving')")
    assert page.drawn["spec"]["scale_mm"] == 96.0
    page.page.wait_for_selector("#status:has-text(' 1 s')")
    page.page.click("#cancel")
    assert page.status == "Not solved"
    page.page.unroute("**/design")
    page.page.click("#cancel:has-text('Solve')")
    page.settled()
    assert page.drawn["kind"] == "exact" and page.drawn["spec"]["scale_mm"] == 96.0
    assert page.page.is_hidden("#cancel")


def test_the_share_of_the_searches_done_grows_while_a_design_is_solved(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    page.page.evaluate(
        """() => {
      const bar = document.querySelector("#progress");
      window.shares = [];
      new MutationObserver(() => shares.push(bar.value)).observe(bar, { attributeFilter: ["value"] });
    }"""
    )
    bar = page.page.get_by_role("progressbar", name="Progress of the search for the exact design")
    assert bar.count() == 0
    typed(page, "Rows", "4")
    bar.wait_for()
    page.page.wait_for_selector("#status.exact")
    assert bar.count() == 0
    shares = page.page.evaluate("shares")
    assert shares == sorted(shares) and {0.0, 1.0} < set(shares)
    assert [shift for shift in page.shifts() if shift[0] > 0.005] == []


def test_what_is_no_longer_shown_is_dimmed_until_something_is(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    page.page.route("**/design", lambda route: None)
    page.page.route("**/preview", lambda route: None)
    typed(page, "Scale", "97")
    page.page.wait_for_selector("#status.solving")
    assert page.page.evaluate("getComputedStyle(document.querySelector('#sensor svg')).opacity") == "0.5"


def test_a_link_names_its_camera_and_opens_at_its_tab(browser: Any, page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio, f"{SMALL}&camera=d435")
    assert page.drawn["spec"]["camera"]["name"] == "Intel RealSense D435, colour"
    page.page.click("#build-tab")
    assert "camera=d435" in page.page.url and "tab=build" in page.page.url
    with browser_page(browser) as other:
        other.open(page.page.url)
        other.settled()
        assert other.page.is_visible("#make") and other.drawn["identity"] == page.drawn["identity"]


def test_mirrors_are_rectangles_of_stock(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    page.page.get_by_role("combobox", name="Shape of a mirror").select_option("stock:")
    page.page.wait_for_selector("#status.exact")
    assert page.drawn["spec"]["shape"].startswith("stock:")
    page.page.get_by_role("textbox", name="Sizes in stock, mm").fill("50x30, 30x20")
    page.page.keyboard.press("Enter")
    page.page.wait_for_selector("#status.exact")
    assert page.drawn["spec"]["shape"] == "stock:30x20,50x30"
    assert "shape=stock" in page.page.url


def test_a_pattern_and_mirrors_are_chosen_by_name(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    page.page.get_by_role("combobox", name="Mirrors").select_option("second, glass 2 mm")
    page.page.wait_for_selector("#status.exact")
    chosen = {name: page.drawn["spec"][name] for name in ("surface", "thickness_mm", "refractive_index")}
    assert chosen == {"surface": "second", "thickness_mm": 2, "refractive_index": 1.52}
    page.page.get_by_role("combobox", name="Arrangement").select_option("ring of 6")
    page.page.wait_for_selector("#sensor path.mirror >> nth=5")
    assert "pattern=ring6" in page.page.url
    assert page.page.is_hidden("[data-name=rows]")
    page.page.click("#undo")
    page.page.wait_for_selector("#status.exact")
    assert len(page.drawn["mirrors"]) == 2 and page.page.is_visible("[data-name=rows]")


def test_a_point_of_the_map_is_a_design_to_open(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio, f"{SMALL}&scale_mm=71")
    page.page.get_by_role("combobox", name="Horizontal axis").select_option("size")
    typed(page, "Scale", "72")
    page.settled()
    page.page.wait_for_selector("#map circle:not(.here)")
    assert page.page.locator("#map circle[tabindex='0']").count() == 1
    page.page.focus("#map circle.here")
    page.page.keyboard.press("ArrowLeft")  # smaller
    page.page.keyboard.press("Enter")
    page.page.wait_for_function("() => Studio.designer.state.drawing.spec.scale_mm === 71")
    page.settled()
    assert "scale_mm=71" in page.page.url


def test_a_finger_scrolls_past_the_mirrors_and_turns_them_sideways(browser: Any, studio: tuple[str, Path]) -> None:
    with browser_page(browser, NARROW, has_touch=True, is_mobile=True) as watched:
        opened(watched, studio)
        page, touch = watched.page, watched.page.context.new_cdp_session(watched.page)
        page.evaluate("document.getElementById('panels').scrollIntoView()")
        place = "[document.querySelector('.viewing').scrollTop, Studio.view.camera.position.toArray().join()]"

        def swiped(dx: int, dy: int) -> tuple[float, str]:
            """How far the page scrolled, and the view's position."""
            box = page.locator("#stage canvas").bounding_box()
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            before = page.evaluate(place)[0]
            touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
            for k in range(1, 11):
                point = {"x": x + dx * k / 10, "y": y + dy * k / 10}
                touch.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [point]})
            touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
            page.wait_for_timeout(300)
            after, position = page.evaluate(place)
            return after - before, position

        position = page.evaluate(place)[1]
        scrolled, same = swiped(0, -90)
        assert scrolled > 45 and same == position
        scrolled, turned = swiped(90, 0)
        assert scrolled == 0 and turned != position


PAIR = '#pattern={"name":"pair","positions":[[0,0],[1,0]]}'
"""Two views, whose number a target does not vary."""


def test_a_target_leads_to_a_design(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio, PAIR)
    page.page.click("#target summary")
    for name, value in (("sigma", "1"), ("distance", "300"), ("width", ""), ("height", ""), ("mass", "500")):
        page.page.fill(f"#target-form [name={name}]", value)
    page.page.click("#target-form button")
    page.page.wait_for_selector("#target-note progress")
    page.page.wait_for_selector("#targets button", timeout=120_000)
    assert "meet the target" in page.page.inner_text("#target-note")
    page.page.click("#targets button >> nth=0")
    page.settled()
    assert (page.drawn["kind"], page.drawn["spec"]["depths_mm"]) == ("exact", [300.0])


@pytest.mark.parametrize("request_", [{"rows": 2}, {"scale_mm": 60.0, "depths_mm": [200.0, 400.0]}, {}, "pattern"])
def test_an_address_leads_to_its_design_whatever_the_studio_began_with(
    page: Watched, studio: tuple[str, Path], request_: dict[str, Any] | str
) -> None:
    opened(page, studio)
    hexagonal = DesignSpec(pattern=Pattern.hexagonal(1))
    asked = hexagonal if isinstance(request_, str) else DesignSpec().replaced(**request_)
    defaults, begun = (each.model_dump(mode="json") for each in (DesignSpec(), DesignSpec(rows=4, fold_deg=100.0)))
    wanted = asked.model_dump(mode="json")
    back = "([spec, defaults, begun]) => Studio.fromAddress(`#${Studio.toAddress(spec, defaults)}`, defaults, begun)"
    found = page.page.evaluate(back, [wanted, defaults, begun])
    assert DesignSpec.model_validate(found) == asked


def test_a_number_that_cannot_be_is_refused_at_its_field(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    field = page.page.get_by_role("spinbutton", name="Rows, number")
    field.fill("99")
    page.page.keyboard.press("Enter")
    assert page.page.locator("input:invalid").count() == 1
    assert page.drawn["spec"]["rows"] == 1
    assert "rows=99" not in page.page.url


def test_an_address_gives_the_same_design_again(browser: Any, page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio, f"{SMALL}&scale_mm=60&surface=second")
    assert page.drawn["spec"]["surface"] == "second"
    with browser_page(browser) as other:
        other.open(page.page.url)
        other.settled()
        assert other.drawn["identity"] == page.drawn["identity"]


def test_the_keyboard_alone_changes_a_design(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    for _ in range(60):
        page.page.keyboard.press("Tab")
        if page.page.evaluate("document.activeElement.getAttribute('aria-label')") == "Columns":
            break
    page.page.keyboard.press("ArrowRight")
    page.page.wait_for_selector("#sensor path.mirror >> nth=2")
    page.settled()
    assert page.drawn["spec"]["cols"] == 3
    page.page.keyboard.press("Control+z")
    page.settled()
    assert page.drawn["spec"]["cols"] == 2


def test_a_design_that_cannot_be_says_why_and_where_and_offers_the_nearest_that_can(
    page: Watched, studio: tuple[str, Path]
) -> None:
    opened(page, studio, f"{SMALL}&min_edge_mm=80&shape=free")
    assert page.status == "Not feasible"
    assert "Mirrors cannot have edges of 80 mm" in page.page.inner_text("#finding")
    assert page.page.locator("#sensor path.wrong").count() == 2
    page.page.wait_for_selector("#looking", state="hidden")
    offered = page.page.locator("#suggestions button").all_inner_texts()
    assert any(text.startswith("Shortest edge 7") and text.endswith("instead of 80 mm") for text in offered)
    assert [shift for shift in page.shifts() if shift[0] > 0.005] == []
    page.page.click("#suggestions button >> nth=0")
    page.page.wait_for_selector("#status.exact")
    assert not page.page.is_visible("#infeasible")
    page.page.click("#undo")
    page.page.wait_for_selector("#status.failed")


def test_what_is_no_longer_wanted_holds_no_connection(page: Watched, studio: tuple[str, Path]) -> None:
    given_up: list[str] = []
    page.page.on("requestfailed", lambda request: given_up.append(request.url.rsplit("/", 1)[1]))
    page.page.route("**/frame", lambda route: None)  # it takes forever
    opened(page, studio)
    for scale in (81, 82, 83, 84, 85, 86, 87):
        page.page.get_by_role("spinbutton", name="Scale, number").fill(str(scale))
        page.page.keyboard.press("Enter")
        page.page.wait_for_selector("#status.exact")
    assert given_up.count("frame") == 7  # a browser opens six connections to one place


def test_a_request_that_is_none_is_refused_in_words(page: Watched, studio: tuple[str, Path]) -> None:
    previews: list[Any] = []
    page.page.route("**/preview", lambda route: previews.extend([route]))
    opened(page, studio, "#rows=99")
    with page.page.expect_response("**/preview"):  # its refusal, whenever it comes, does not replace the reason
        previews[0].continue_()
    page.page.evaluate("() => new Promise((done) => setTimeout(done, 50))")
    assert page.status == "Invalid request"
    assert page.page.inner_text("#finding") == "Rows: expected at most 12"
    assert page.page.inner_text("#infeasible-title") == "This is not a valid request"


def test_pinned_designs_are_shown_next_to_the_current_one(page: Watched, studio: tuple[str, Path]) -> None:
    opened(page, studio)
    page.page.click("#pin")
    page.page.get_by_role("spinbutton", name="Scale, number").fill("100")
    page.page.keyboard.press("Enter")
    page.page.wait_for_selector("#status.exact")
    assert page.page.input_value("#compare input") == "1 x 2, 80 mm"
    text = page.page.inner_text("#compare")
    assert "1 x 2, 100 mm (now)" in text
    assert "Differences of the requests" in text
    assert "\nScale" in text
    assert "Usable pixels at 300 mm" in text
    assert "to 1 x 2, 80 mm" in page.page.inner_text("#tiles")
    page.page.fill("#compare input", "mine")
    page.page.keyboard.press("Enter")
    page.page.reload()
    page.settled()
    assert page.page.input_value("#compare input") == "mine"
    page.page.click("#compare >> text=Go to")
    page.page.wait_for_selector("#status.exact")
    assert page.drawn["spec"]["scale_mm"] == 80.0


def test_files_of_a_design_are_saved_and_opened_again(page: Watched, studio: tuple[str, Path], tmp_path: Path) -> None:
    opened(page, studio, f"{SMALL}&scale_mm=70")
    identity = page.drawn["identity"]

    page.page.click("#build-tab")

    def saved(button: str) -> Path:
        with page.page.expect_download(timeout=120_000) as download:  # a report takes long: it studies devices as built
            page.page.click(f"[data-file={button}]")
        path = tmp_path / download.value.suggested_filename
        download.value.save_as(path)
        return path

    assert Layout.load(saved("layout")).identity == identity
    request = saved("request")
    assert read_request(request).scale_mm == 70.0
    report = saved("report").read_text(encoding="utf-8")
    assert identity in report
    assert report.count("data:image/png;base64,") == 3
    page.page.click("#design-tab")
    page.page.get_by_role("spinbutton", name="Scale, number").fill("90")
    page.page.keyboard.press("Enter")
    page.page.wait_for_selector("#status.exact")
    page.page.set_input_files("#open", request)
    page.page.wait_for_selector("#make-note:has-text('opened')", state="attached")
    page.page.wait_for_selector("#status.exact")
    assert page.drawn["identity"] == identity
    page.page.set_input_files("#open", {"name": "bad.toml", "mimeType": "text/plain", "buffer": b"rows = 'three'"})
    page.page.wait_for_selector("#make-note:has-text('bad.toml')", state="attached")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_nothing_shifts_and_everything_is_accessible(
    browser: Any, studio: tuple[str, Path], size: tuple[int, int], scheme: Literal["light", "dark"]
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with browser_page(browser, size, scheme) as watched:
        watched.open(studio[0] + SMALL)
        watched.settled()
        watched.page.click("#pin")
        watched.page.wait_for_timeout(500)
        assert [shift for shift in watched.shifts() if shift[0] > 0.005] == []
        wider = watched.page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wider <= 0
        found = axe.Axe().run(watched.page).response["violations"]
        assert [(each["id"], [node["html"][:120] for node in each["nodes"][:3]]) for each in found] == []
        assert watched.errors == []


def test_a_page_without_a_server_shows_the_designs_that_it_carries(
    browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    spec = DesignSpec(depths_mm=(300.0,))
    grid = AtlasGrid(rows=(1, 2), cols=(1, 2), scales_mm=(60.0, 80.0), tradeoffs=(0.3,))

    def write(folder: Path) -> None:
        folder.mkdir()
        page = snapshot_page(spec, atlas(spec, grid, workers=1))
        (folder / "page.html").write_text(page, encoding="utf-8")

    path = built_once(tmp_path_factory, "studio_snapshot", write) / "page.html"
    with browser_page(browser) as watched:
        watched.page.goto(path.as_uri() + "#rows=2&cols=2")
        watched.settled()
        assert len(watched.drawn["mirrors"]) == 4
        watched.page.get_by_role("slider", name="Scale").press("ArrowLeft")
        watched.settled()
        assert watched.drawn["title"] == "2 x 2, 60 mm"
        watched.page.get_by_role("slider", name="Rows").press("ArrowLeft")
        watched.page.get_by_role("slider", name="Columns").press("ArrowLeft")
        watched.page.wait_for_selector("#status.failed")
        assert "at least two" in watched.page.inner_text("#finding")
        assert watched.errors == []


def test_only_scripts_with_the_nonce_run() -> None:
    page = studio_page(DesignSpec(), Path("somewhere"), nonce="abc")
    assert page.count("<script") == page.count('nonce="abc"') - page.count("<style")


def test_no_text_ends_the_script_that_holds_it() -> None:
    assert "<" not in script_json({"name": "</script><script>alert(1)"})
