"""The picture of docs/studio.md is of the live page as it is now: it is taken here, and compared with that in docs.

MIRRORCAM_PICTURES=write pytest -n 0 tests/studio/live/test_live_guide.py      # replaces that in docs
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.preview.preview_frame import preview_frame
from tests.conftest import ROOT
from tests.core.video.videos import write_mjpeg
from tests.optics.drift.calibrated_device import turned
from tests.studio.browser import browser_page, served
from tests.studio.live.live_sets import repeated

pytestmark = pytest.mark.slow

SIZE = (1400, 1430)
COARSE = (70, 72)
UNLIKE_GREY = 12.0
"""Mean difference, in grey levels, at a twentieth of the size: other fonts make less, other panels more."""
TURN_DEG = np.array([0.0, 0.5, 0.0])
"""Of the mirror at the right of the middle: the table is to tell it."""
LONG_MS = 90_000


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory, default_layout: Layout) -> Iterator[str]:
    """A live page on the table-top, seen by a device of which one mirror is turned."""
    folder = tmp_path_factory.mktemp("live_guide")
    frame = preview_frame(turned(default_layout, 5, TURN_DEG), width_px=1280, arranged_for=default_layout)
    default_layout.replaced(camera=frame.layout.camera).save(folder / "layout.json")
    repeated(write_mjpeg(folder / "once.avi", [frame.picture.copy()]), folder / "camera.mkv", 6000)
    given = (str(folder / "camera.mkv"), "--layout", str(folder / "layout.json"))
    with served(folder / "out", "live", *given) as address:
        yield address


def test_the_picture_of_the_guide_shows_the_page_as_it_is(browser: Any, address: str) -> None:
    with browser_page(browser, SIZE) as watched:
        watched.open(address)
        watched.page.check("#align")
        watched.page.wait_for_selector("#tilts tbody tr:nth-child(6) td:has-text('°')", timeout=LONG_MS)
        watched.page.wait_for_selector("#depth[data-serial]", timeout=LONG_MS)
        rows = watched.page.locator("#tilts tbody tr").all_inner_texts()
        watched.page.wait_for_timeout(500)
        taken = Image.open(BytesIO(watched.page.screenshot())).convert("RGB")
    path = ROOT / "docs" / "images" / "live.jpg"
    if os.environ.get("MIRRORCAM_PICTURES") == "write":
        taken.save(path, quality=86)
    assert "°" in rows[5].split("\t")[3], rows
    before = Image.open(path)
    assert before.size == SIZE
    now, then = (np.asarray(image.resize(COARSE, Image.Resampling.BOX), dtype=float) for image in (taken, before))
    assert np.abs(now - then).mean() < UNLIKE_GREY


def test_the_guide_shows_it() -> None:
    assert "images/live.jpg" in (ROOT / "docs" / "studio.md").read_text(encoding="utf-8")
    assert Path(ROOT / "docs" / "images" / "live.jpg").stat().st_size < 500_000
