"""Pictures, guide and page of a complete device: their content, working links, and nothing fetched."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.guide.device_page import WEB
from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.html.templates import KIT
from mirrorcam.core.values import Metric
from tests.cad.guide.conftest import CHECKS, Made, write_documents

pytestmark = pytest.mark.slow

# Elements that extend past the right edge of the window: their section and text.
BEYOND = """() => [...document.querySelectorAll("#files *, .guide *")]
  .filter((e) => !e.closest("pre") && e.getBoundingClientRect().right > innerWidth + 1)
  .map((e) => [e.closest("section").id, e.textContent.slice(0, 60)])"""


class Links(HTMLParser):
    """The addresses in a page, by attribute, and its ids."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.named: list[str] = []
        self.ids: set[str] = set()
        self.scripts: dict[str, str] = {}
        self._open = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("href", "src", "srcset", "poster", "data", "action", "xlink:href"):
                self.named.append(value or "")
            if name == "id":
                self.ids.add(value or "")
        self._open = (dict(attrs).get("id") or "") if tag == "script" else ""

    def handle_data(self, data: str) -> None:
        if self._open:
            self.scripts[self._open] = self.scripts.get(self._open, "") + data


def will_exist(made: Made) -> set[str]:
    """Files below the folder: those written, and those that a complete build adds."""
    written = {path.relative_to(made.folder).as_posix() for path in made.folder.rglob("*")}
    of_parts = {f"parts/{part.name}.{kind}" for part in made.parts for kind in ("step", "stl", "3mf")}
    stems = (*(part.name for part in made.parts), "assembly")
    drawings = {f"drawings/{stem}.{kind}" for stem in stems for kind in ("svg", "pdf")}
    return (
        written
        | of_parts
        | drawings
        | {"plates/plate_1.3mf", "pictures/live_view.png", "pictures/live_overlay.png"}
        | {picture.path for picture in made.pictures}
        | {"checks.json", "robot/mirrorcam.xacro", "drawings/side_view.svg", "source/hardware.toml"}
        | {"mirrors/cutting.md", "mirrors/scale_bar.svg"}
    )


def test_every_link_leads_to_a_file_or_a_place_on_the_page(made: Made) -> None:
    links = Links((made.folder / "index.html").read_text(encoding="utf-8"))
    there = will_exist(made) | {f"#{name}" for name in links.ids}
    assert set(links.named) - there == set()
    assert {f"parts/{part.name}.3mf" for part in made.parts} < set(links.named)
    assert {picture.path for picture in made.pictures} < set(links.named)
    assert "mirrors/mirrors.dxf" in links.named
    in_guide = set(re.findall(r"\]\(([^)]*)\)", (made.folder / "guide.md").read_text(encoding="utf-8")))
    assert in_guide - there == set()


def test_nothing_on_the_page_is_fetched_from_elsewhere(made: Made) -> None:
    page = (made.folder / "index.html").read_text(encoding="utf-8")
    assert not [link for link in Links(page).named if re.match(r"[a-z]+:|//", link)]
    css = (WEB / "viewer.css").read_text(encoding="utf-8")
    assert "@import" not in css
    assert "url(" not in css
    # Its only address is a namespace; the model loader fetches files that a model names, and ours names none.
    script = (WEB / "page.js").read_text(encoding="utf-8") + (KIT / "three.bundle.js").read_text(
        encoding="utf-8"
    ).partition("*/")[2]
    assert set(re.findall(r"https?://[\w./-]+", script)) <= {"http://www.w3.org/1999/xhtml"}
    header = json.loads(model_json((made.folder / "assembly.glb").read_bytes()))
    assert not [buffer for buffer in (*header["buffers"], *header.get("images", ())) if "uri" in buffer]


def model_json(glb: bytes) -> bytes:
    """The JSON chunk of a GLB file: 12 bytes of header, then length, type and data."""
    length = int.from_bytes(glb[12:16], "little")
    assert glb[16:20] == b"JSON"
    return glb[20 : 20 + length]


def test_the_page_carries_the_model_and_its_rays(made: Made) -> None:
    scripts = Links((made.folder / "index.html").read_text(encoding="utf-8")).scripts
    glb = base64.b64decode(scripts["glb"])
    assert glb == (made.folder / "assembly.glb").read_bytes()
    extras = [node["extras"] for node in json.loads(model_json(glb))["nodes"] if "kind" in node.get("extras", {})]
    assert len(extras) == len(made.components)
    assert {"kind", "number", "title", "explode_mm"} <= set(extras[0])
    # Each ray is reflected by its mirror.
    rays = np.array(json.loads(scripts["data"])["rays_mm"])
    for (start, bounce, end), mirror in zip(rays, made.device.layout.mirrors, strict=True):
        there, back = (bounce - start) / np.linalg.norm(bounce - start), (end - bounce) / np.linalg.norm(end - bounce)
        normal = mirror.normal_in_rig
        np.testing.assert_allclose(back, there - 2.0 * (there @ normal) * normal, atol=1e-4)


def test_every_plate_names_its_parts_and_what_comes_before_it(made: Made, tmp_path: Path) -> None:
    plated = tmp_path / "plated"
    shutil.copytree(made.folder, plated)
    plates = {"plates/plate_1.3mf": ("mirror_holder", "mount"), "plates/plate_2.3mf": ("camera_clip",)}
    for path in plates:
        write_bytes(plated / path, b"")
    write_documents(Made(plated, made.device, made.parts, made.components, made.pictures, plates))
    page = (plated / "index.html").read_text(encoding="utf-8")
    for listed in ("MC-01 Mirror holder, MC-02 Mount", "MC-03 Camera clip"):
        coupon = "MC-06 Fit coupon comes first, alone, from its own file"
        assert f"<span>{listed}: printed together, with print settings; {coupon}</span>" in page


def test_the_model_says_which_printed_parts_it_lacks(made: Made) -> None:
    scripts = Links((made.folder / "index.html").read_text(encoding="utf-8")).scripts
    lacking = json.loads(scripts["data"])["not_shown"]
    absent = {part.name for part in made.parts} - {component.name for component in made.components}
    titles = [f"{part.number} {part.title}" for part in made.parts if part.name in absent]
    assert titles and all(title in lacking for title in titles)


@pytest.mark.parametrize("width", [1400, 400])
def test_tables_of_files_and_gauges_stay_on_the_screen(made: Made, flat_browser: Any, width: int) -> None:
    page = flat_browser.new_page(viewport={"width": width, "height": 900})
    page.goto((made.folder / "index.html").as_uri())
    found = page.evaluate(BEYOND)
    wider = page.evaluate("document.documentElement.scrollWidth - innerWidth")
    page.close()
    assert wider <= 0
    # At no width does the list of files overflow; on a wide screen no table scrolls.
    assert [text for table, text in found if width > 1000 or table == "files"] == []


def test_a_failed_check_is_reported_at_the_top_and_in_its_row(made: Made, tmp_path: Path) -> None:
    assert "all 3 checks pass" in (made.folder / "index.html").read_text(encoding="utf-8")
    broken = tmp_path / "broken"
    shutil.copytree(made.folder, broken)
    thin = CHECKS | {"mirror_holder.wall_mm": Metric(value=0.4, unit="mm", limit=1.2, lower_is_better=False)}
    write_documents(Made(broken, made.device, made.parts, made.components, made.pictures), thin)
    page = (broken / "index.html").read_text(encoding="utf-8")
    assert "1 of 3 checks failed" in page
    row = next(line for line in page.splitlines() if ">0.4 mm<" in line)
    assert 'class="bad"' in row
    assert "≥ 1.2 mm" in row
    assert "FAIL" in row


def test_what_the_page_quotes_is_escaped(made: Made, tmp_path: Path) -> None:
    odd = tmp_path / "odd"
    shutil.copytree(made.folder, odd)
    camera = made.device.hardware.camera.replaced(name="<script>alert(1)</script>")
    device = plan_device(made.device.layout, made.device.hardware.replaced(camera=camera))
    write_documents(Made(odd, device, made.parts, made.components, made.pictures))
    assert "<script>alert(1)" not in (odd / "index.html").read_text(encoding="utf-8")


@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_a_browser_without_a_network_shows_the_model(made: Made, tmp_path: Path) -> None:
    document = browse(made.folder / "index.html", tmp_path, "--use-gl=angle", "--use-angle=swiftshader")
    assert f'data-ready="{len(made.components)}"' in document
    assert document.count('type="checkbox"') > len(made.components)
    without = browse(made.folder / "index.html", tmp_path, "--disable-3d-apis")
    assert 'class="flat"' in without
    assert "does not support 3-D graphics" in without


def browse(page: Path, profile: Path, *flags: str) -> str:
    """The document after its scripts have run, without name resolution."""
    command = ["chromium", "--headless", "--no-sandbox", "--enable-unsafe-swiftshader", f"--user-data-dir={profile}"]
    command += [
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--virtual-time-budget=2500",
        "--window-size=400,400",
        "--dump-dom",
        *flags,
    ]
    return subprocess.run(
        [*command, page.as_uri()], capture_output=True, encoding="utf-8", check=True, timeout=120
    ).stdout
