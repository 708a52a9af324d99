"""`mirrorcam demo`: its page draws what the program renders, in a browser, from the base installation alone."""

from __future__ import annotations

import base64
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import mirrorcam.studio.demo as package
from mirrorcam.optics.light_field.render.perspective import render_view
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, RenderedPicture, refocus, to_bytes
from mirrorcam.studio.demo.decoded_frame import DecodedFrame
from mirrorcam.studio.demo.demo_page import demo_page
from tests.command_line import assert_refused, results
from tests.studio.browser import NARROW, WIDE, Watched, browser_page

SHIPPED = Path(package.__path__[0])
READY_MS = 60_000
EXTRAS = {"starlette", "uvicorn", "mitsuba", "build123d", "OCP", "trimesh", "rosbags", "rerun"}
STORED_GREY = 2.5
"""Mean difference in grey levels by JPEG and by depths of 8 bits."""
OUTLIERS = 0.03
"""Share of pixels, at edges of depth, where 8 bits change which views count."""


def test_files_of_others_are_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    assert_refused(tmp_path, "demo --no-browser --out .", "index.html: was not written by this command")


@pytest.mark.slow
def test_the_base_installation_writes_the_page_and_its_inputs(tmp_path: Path) -> None:
    program = (
        "import json, sys\nfrom mirrorcam import cli\n"
        "code = cli.main(['demo', '--no-browser', '--quiet', '--out', 'demo'])\n"
        "print(json.dumps([code, sorted({name.split('.')[0] for name in sys.modules})]))"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    code, modules = json.loads(done.stdout)
    assert code == 0
    assert EXTRAS & set(modules) == set()
    assert results(tmp_path / "demo") == ["frame.jpg", "index.html", "layout.json"]
    page = (tmp_path / "demo" / "index.html").read_text(encoding="utf-8")
    assert len(page) < 5_000_000
    assert re.findall(r'(?:src|href)="(?!data:)[^"]*"', page) == []


@pytest.fixture(scope="module")
def decoded() -> DecodedFrame:
    return DecodedFrame.of(SHIPPED / "frame.jpg", SHIPPED / "layout.json")


@pytest.fixture(scope="module")
def page(decoded: DecodedFrame, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("demo") / "index.html"
    path.write_text(demo_page(decoded, Path("demo")), encoding="utf-8")
    return path


@contextmanager
def opened(browser: Any, page: Path, size: tuple[int, int] = WIDE, **context: Any) -> Iterator[Watched]:
    """The page with its pictures drawn, at rest."""
    with browser_page(browser, size, reduced_motion="reduce", **context) as watched:
        watched.page.goto(page.as_uri())
        watched.page.wait_for_selector("body[data-ready]", timeout=READY_MS)
        yield watched


def drawn(watched: Watched, name: str, values: dict[str, float]) -> NDArray[np.uint8]:
    """The picture (h, w, 3) of a canvas after sliders have moved."""
    script = """async ([name, values]) => {
      for (const [id, value] of Object.entries(values)) {
        document.getElementById(id).value = value;
        document.getElementById(id).dispatchEvent(new Event("input"));
      }
      for (let i = 0; i < 3; i++) await new Promise(requestAnimationFrame);
      return document.getElementById(name).toDataURL();
    }"""
    content = base64.b64decode(watched.page.evaluate(script, [name, values]).split(",")[1])
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture, dtype=np.uint8)[..., ::-1]


def differences(picture: NDArray[np.uint8], expected: RenderedPicture) -> NDArray[np.floating]:
    """Largest difference of the channels of each pixel that has samples, in grey levels."""
    return np.abs(picture.astype(float) - to_bytes(expected)).max(axis=-1)[expected.valid]


@pytest.mark.slow
@pytest.mark.parametrize("level", [40, 200])
def test_the_page_refocuses_as_the_program_does(browser: Any, page: Path, decoded: DecodedFrame, level: int) -> None:
    with opened(browser, page) as watched:
        picture = drawn(watched, "refocus", {"focus": level})
        far, near = watched.page.evaluate("JSON.parse(document.getElementById('start').textContent).inverse_mm")
        depth_mm = 1.0 / (far + level / 255 * (near - far)) + decoded.light_field.reference_view_depth_mm
        assert f"Focused at {depth_mm:.0f} mm" in watched.page.inner_text("#focus-text")
        expected = refocus(decoded.dense, FocalPlane.at_depth(decoded.light_field, depth_mm))
        assert differences(picture, expected).mean() < STORED_GREY
        assert watched.errors == []


@pytest.mark.slow
def test_the_page_shows_new_viewpoints_as_the_program_does(browser: Any, page: Path, decoded: DecodedFrame) -> None:
    with opened(browser, page) as watched:
        still = drawn(watched, "viewpoint", {"right": 0, "down": 0})
        picture = drawn(watched, "viewpoint", {"right": 0.7, "down": -0.5})
        low, high = watched.page.evaluate("JSON.parse(document.getElementById('start').textContent).viewpoint_mm")
    position = np.append(np.array(low) + np.array([0.85, 0.25]) * (np.array(high) - low), 0.0)
    expected = render_view(decoded.light_field, decoded.depths, position)
    found = differences(picture, expected)
    assert np.median(found) < STORED_GREY
    assert (found > 40.0).mean() < OUTLIERS
    assert differences(still, expected).mean() > 4.0 * found.mean()


@pytest.mark.slow
def test_the_pointer_focuses_moves_and_marks(browser: Any, page: Path) -> None:
    with opened(browser, page) as watched:
        watched.page.hover("#refocus", position={"x": 60, "y": 120})
        said = "document.getElementById('{}').textContent"
        watched.page.wait_for_function(said.format("focus-text") + ".includes('at 36')")
        watched.page.hover("#viewpoint", position={"x": 10, "y": 10})
        watched.page.wait_for_function(
            "/left of and .* above/.test(document.getElementById('viewpoint-text').textContent)"
        )
        watched.page.hover("#points circle >> nth=0", force=True)
        assert watched.page.locator("#seen circle").count() >= 5
        assert "mm, found in" in watched.page.inner_text("#feature-text")
        assert watched.errors == []


@pytest.mark.slow
@pytest.mark.parametrize(("size", "scheme"), [(WIDE, "light"), (NARROW, "dark")])
def test_everything_is_accessible(
    browser: Any, page: Path, size: tuple[int, int], scheme: Literal["light", "dark"]
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with opened(browser, page, size, scheme=scheme) as watched:
        found = axe.Axe().run(watched.page).response["violations"]
        assert [(each["id"], [node["html"][:120] for node in each["nodes"][:3]]) for each in found] == []
        assert watched.page.evaluate("document.documentElement.scrollWidth") <= size[0]


@pytest.mark.slow
@pytest.mark.parametrize(("width", "columns"), [(1400, 3), (940, 2), (800, 2), (390, 1)])
def test_the_panels_fill_their_rows(browser: Any, page: Path, width: int, columns: int) -> None:
    with opened(browser, page, (width, 900)) as watched:
        tops = watched.page.eval_on_selector_all(".panel", "all => all.map((panel) => panel.offsetTop)")
        assert sorted(tops) == tops
        assert [tops.count(top) for top in dict.fromkeys(tops)] == [columns] * (len(tops) // columns)


@pytest.mark.slow
def test_without_webgl_the_page_says_so_and_shows_the_rest(flat_browser: Any, page: Path) -> None:
    with opened(flat_browser, page) as watched:
        assert "no WebGL 2" in watched.page.inner_text("#failed")
        assert drawn(watched, "refocus", {"focus": 40}).std() > 30.0
        assert watched.page.locator("#points circle").count() > 100


@pytest.mark.slow
def test_the_code_compiled_ahead_is_that_which_the_frame_needs(tmp_path: Path) -> None:
    def run(call: str) -> set[str]:
        program = (
            "from pathlib import Path\nfrom mirrorcam.studio.demo.decoded_frame import DecodedFrame, compile_ahead\n"
            f"{call}(Path({str(SHIPPED / 'frame.jpg')!r}), Path({str(SHIPPED / 'layout.json')!r}))"
        )
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        subprocess.run([sys.executable, "-c", program], env=environment, check=True)
        return {path.name for path in tmp_path.rglob("*.nbc")}

    ahead, needed = run("compile_ahead"), run("DecodedFrame.of")
    functions = {name.split("-")[0] for name in needed}
    assert {"semiglobal._paths", "refine_kernels.conjugate_gradients"} <= {name.split("-")[0] for name in ahead}
    # A call with other types would have compiled a function again.
    assert len(functions) == len(needed)
