"""The pictures of docs/studio.md are of the page as it is now: they are taken here, and compared with those in docs.

MIRRORCAM_PICTURES=write pytest -n 0 tests/studio/test_guide.py      # replaces those in docs
"""

from __future__ import annotations

import os
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.conftest import ROOT
from tests.studio.browser import Watched, browser_page

pytestmark = pytest.mark.slow

SIZE = (1400, 900)
COARSE = (70, 45)
UNLIKE_GREY = 12.0
"""Mean difference, in grey levels, at a twentieth of the size: other fonts make less, other panels more."""


def design(page: Watched) -> None:
    page.page.wait_for_selector("#status.exact")


def cannot_be(page: Watched) -> None:
    page.page.wait_for_selector("#looking", state="hidden")


def compared(page: Watched) -> None:
    page.page.wait_for_selector("#status.exact")
    page.page.click("#pin")
    page.page.get_by_role("spinbutton", name="Columns, number").fill("4")
    page.page.keyboard.press("Enter")
    page.page.wait_for_selector("#sensor path.mirror >> nth=11")
    page.page.wait_for_selector("#status.exact")
    page.page.click("#pin")
    page.page.evaluate("document.getElementById('compare').scrollIntoView()")
    page.page.evaluate("scrollBy(0, -70)")


STATES: dict[str, tuple[str, Callable[[Watched], None]]] = {
    "design": ("", design),
    "infeasible": ("#rows=2&cols=2&min_edge_mm=90&shape=free", cannot_be),
    "compare": ("", compared),
}


@pytest.mark.parametrize("name", STATES)
def test_the_pictures_of_the_guide_show_the_page_as_it_is(
    name: str, browser: Any, studio: tuple[str, Path], tmp_path: Path
) -> None:
    address, prepare = STATES[name]
    with browser_page(browser, SIZE) as page:
        page.open(studio[0] + address)
        page.settled()
        prepare(page)
        page.page.wait_for_timeout(500)
        taken = Image.open(BytesIO(page.page.screenshot())).convert("RGB")
    path = ROOT / "docs" / "images" / f"studio_{name}.jpg"
    if os.environ.get("MIRRORCAM_PICTURES") == "write":
        taken.save(path, quality=88)
    before = Image.open(path)
    assert before.size == SIZE
    now, then = (np.asarray(image.resize(COARSE, Image.Resampling.BOX), dtype=float) for image in (taken, before))
    assert np.abs(now - then).mean() < UNLIKE_GREY


def test_the_guide_shows_each_of_them() -> None:
    guide = (ROOT / "docs" / "studio.md").read_text(encoding="utf-8")
    for name in STATES:
        assert f"images/studio_{name}.jpg" in guide
