"""Pictures, guide and page of a whole device: what is in them, that links lead somewhere, that nothing is fetched."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mirrorcam.cad.assembly.catalogue import bought_items, parts_of
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.assembly.pieces import Piece, item_pieces, mass_of, pieces_of
from mirrorcam.cad.documents.assembly_guide import write_guide
from mirrorcam.cad.documents.assembly_steps import Stages, home_of
from mirrorcam.cad.documents.device_page import WEB, write_page
from mirrorcam.cad.documents.device_pictures import DevicePicture, pictures_of, write_picture
from mirrorcam.cad.documents.shading import Screen, render
from mirrorcam.cad.mirrors.mirror_dxf import write_dxf
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem, BuiltPart
from mirrorcam.cad.write.bill_of_materials import bill_of, write_bom
from mirrorcam.cad.write.gltf import write_glb
from mirrorcam.cad.write.part_export import write_stl
from mirrorcam.optics.base.files import read_image
from mirrorcam.optics.base.values import Metric
from mirrorcam.optics.geometry.layout import Layout


@dataclass(frozen=True)
class Made:
    folder: Path
    device: Device
    parts: tuple[BuiltPart, ...]
    pieces: tuple[Piece, ...]
    pictures: tuple[DevicePicture, ...]


CHECKS = {
    "mirror_holder.wall_mm": Metric(value=1.31, unit="mm", limit=1.2, lower_is_better=False),
    "mount.overhang_mm2": Metric(value=0.0, unit="mm2", limit=0.5),
    "device.rays_blocked": Metric(value=0.0, unit="", limit=0.0),
    "device.mass_g": Metric(value=467.0, unit="g"),
}


def make(layout: Layout, hardware: Hardware, folder: Path) -> Made:
    """Everything but what takes long: parts as meshes, no solids on disk."""
    device = plan_device(layout, hardware)
    parts = []
    for part in parts_of(device):
        path = folder / "parts" / f"{part.name}.stl"
        write_stl(path, part.make(part.plan))
        parts.append(
            BuiltPart(
                name=part.name,
                title=part.title,
                number=part.number,
                folder=folder / "parts",
                rgb=part.rgb,
                print_from_rig=part.print_from_rig,
                explode_mm=part.explode_mm,
                mass=mass_of(trimesh.load_mesh(path), 1.24),
                checks={},
            )
        )
    pieces = pieces_of(device, parts)
    return Made(folder, device, tuple(parts), pieces, pictures_of(device, parts, pieces))


@pytest.fixture(scope="module")
def made(make_parabola: Callable[..., Layout], tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A small device with its model, parts list, guide and page."""
    layout = make_parabola(2, 2, scale_mm=40.0, gap_mm=2.0)
    device = make(layout, HARDWARE, tmp_path_factory.mktemp("documents"))
    write_glb(device.folder / "assembly.glb", device.pieces)
    for sheet in plan_sheets(layout, HARDWARE.cutting):
        write_dxf(device.folder / "mirrors" / f"{sheet.stem}.dxf", sheet)
    write_bom(device.folder, bill_of(device.device, device.parts, ()))
    write_documents(device)
    return device


def write_documents(made: Made, checks: dict[str, Metric] = CHECKS) -> None:
    write_guide(made.folder, made.device, made.parts, made.pieces)
    write_page(made.folder, made.device, made.parts, made.pictures, checks)


class Links(HTMLParser):
    """All that a page names: addresses by attribute, and ids."""

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
    """Files below the folder: those written, and those that a whole build writes beside them."""
    written = {path.relative_to(made.folder).as_posix() for path in made.folder.rglob("*")}
    of_parts = {f"parts/{part.name}.{kind}" for part in made.parts for kind in ("step", "stl", "3mf")}
    drawings = {f"drawings/{part.name}.{kind}" for part in made.parts for kind in ("svg", "pdf")}
    return (
        written
        | of_parts
        | drawings
        | {picture.path for picture in made.pictures}
        | {"checks.json", "robot/mirrorcam.xacro"}
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
    # Its one address is a namespace; the loader of models fetches what a model names, and ours names nothing.
    script = (WEB / "page.js").read_text(encoding="utf-8") + (WEB / "three.bundle.js").read_text(
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
    assert len(extras) == len(made.pieces)
    assert {"kind", "number", "title", "explode_mm"} <= set(extras[0])
    # Each ray leaves the mirror as the mirror says.
    rays = np.array(json.loads(scripts["data"])["rays_mm"])
    for (start, bounce, end), mirror in zip(rays, made.device.layout.mirrors, strict=True):
        there, back = (bounce - start) / np.linalg.norm(bounce - start), (end - bounce) / np.linalg.norm(end - bounce)
        normal = mirror.normal_in_rig
        np.testing.assert_allclose(back, there - 2.0 * (there @ normal) * normal, atol=1e-4)


def test_a_failed_check_is_said_at_the_top_and_in_its_row(made: Made, tmp_path: Path) -> None:
    assert "all 3 checks pass" in (made.folder / "index.html").read_text(encoding="utf-8")
    broken = tmp_path / "broken"
    shutil.copytree(made.folder, broken)
    thin = CHECKS | {"mirror_holder.wall_mm": Metric(value=0.4, unit="mm", limit=1.2, lower_is_better=False)}
    write_documents(Made(broken, made.device, made.parts, made.pieces, made.pictures), thin)
    page = (broken / "index.html").read_text(encoding="utf-8")
    assert "1 of 3 checks failed" in page
    row = next(line for line in page.splitlines() if "0.4 mm" in line)
    assert 'class="bad"' in row
    assert "≥ 1.2 mm" in row
    assert "FAIL" in row


def test_what_the_page_quotes_is_escaped(made: Made, tmp_path: Path) -> None:
    odd = tmp_path / "odd"
    shutil.copytree(made.folder, odd)
    camera = made.device.hardware.camera.replaced(name="<script>alert(1)</script>")
    device = plan_device(made.device.layout, made.device.hardware.replaced(camera=camera))
    write_documents(Made(odd, device, made.parts, made.pieces, made.pictures))
    assert "<script>alert(1)" not in (odd / "index.html").read_text(encoding="utf-8")


@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_a_browser_without_a_network_shows_the_model(made: Made, tmp_path: Path) -> None:
    document = browse(made.folder / "index.html", tmp_path, "--use-gl=angle", "--use-angle=swiftshader")
    assert f'data-ready="{len(made.pieces)}"' in document
    assert document.count('type="checkbox"') > len(made.pieces)
    without = browse(made.folder / "index.html", tmp_path, "--disable-3d-apis")
    assert 'class="flat"' in without
    assert "shows no 3-D graphics" in without


def browse(page: Path, profile: Path, *flags: str) -> str:
    """The document after its scripts have run, with no name resolved."""
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


def test_the_guide_takes_every_bought_piece_once(made: Made) -> None:
    stages = Stages(made.pieces)
    taken = [
        *stages.threads,
        *stages.pins,
        *stages.holder_screws,
        *stages.camera_screws,
        *stages.clip_screws,
        *stages.adapter_screws,
    ]
    assert Counter(piece.name for piece in taken) == Counter(
        piece.name for piece in stages.of_kind("screw", "insert", "nut", "pin")
    )
    assert len(taken) == len(bought_items(made.device))


def test_the_guide_follows_the_plan(made: Made, tmp_path: Path) -> None:
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    assert [int(n) for n in re.findall(r"^## Step (\d+)", text, re.MULTILINE)] == list(range(1, 11))
    for word in ("heat-set", "lips", "row 0 is the", made.device.layout.identity, "Ø63"):
        assert word in text
    for name in (picture.name for picture in made.pictures[4:]):
        assert f"(pictures/{name}.png)" in text
    hardware = Hardware.model_validate({"camera": "board_38", "screw": {"kind": "nut"}})
    device = plan_device(made.device.layout, hardware)
    write_guide(tmp_path, device, made.parts, (*made.pieces[: len(made.parts)], *item_pieces(bought_items(device))))
    other = (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert "Set the board on the posts" in other
    assert "Slide each nut" in other
    assert "heat-set" not in other
    assert "soldering iron" not in other


def test_fasteners_find_their_piece_of_a_part_that_is_split(made: Made) -> None:
    holder = next(piece for piece in made.pieces if piece.name == "mirror_holder")
    rest = [piece for piece in made.pieces if piece.name != "mirror_holder"]
    low, high = np.asarray(holder.mesh.bounds)
    halves = []
    for number, side in ((1, -1.0), (2, 1.0)):
        ends = np.array([low, high])
        ends[0 if side > 0.0 else 1, 0] = 0.0
        half = replace(holder, name=f"mirror_holder_{number}", mesh=trimesh.creation.box(bounds=ends))
        halves.append(replace(half, explode_mm=holder.explode_mm + np.array([40.0 * side, 0.0, 0.0])))
    pieces = (*halves, *rest)
    stages = Stages(pieces)
    assert len(stages.threads_in(halves)) == 4
    assert len(stages.holder_screws) == 4
    for thread in stages.threads_in(halves):
        home = home_of(thread, "mirror_holder", halves)
        assert home is not None
        assert np.sign(home.explode_mm[0]) == np.sign(thread.mesh.bounds.mean(axis=0)[0])
    drawn = {picture.name: picture for picture in pictures_of(made.device, made.parts, pieces)}
    assert len(drawn["inserts"].items) > len(stages.threads)


def test_a_split_part_is_pinned_in_the_guide(made: Made, tmp_path: Path) -> None:
    pin = BoughtItem("pin", "3", 16.0, np.eye(4), np.zeros(3), ("mirror_holder_1", "mirror_holder_2"))
    write_guide(tmp_path, made.device, made.parts, (*made.pieces, *item_pieces([pin, pin])))
    assert "Press the pins (2 x 3 x 16 pin)" in (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert "Press the pins" not in (made.folder / "guide.md").read_text(encoding="utf-8")


def test_the_exploded_view_shows_every_part_and_mirror(made: Made) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "exploded")
    points = np.concatenate([item.body.triangles.reshape(-1, 3) for item in picture.items])
    shot = render([item.body for item in picture.items], Screen.around(points, picture.axes, (700, 525), (20, 20)))
    seen = set(np.unique(shot.bodies).tolist())
    shown = [index for index, piece in enumerate(made.pieces) if piece.kind in ("part", "mirror", "camera")]
    assert set(shown) <= seen


def test_a_picture_has_margins_names_and_the_same_bytes(made: Made, tmp_path: Path) -> None:
    picture = next(picture for picture in made.pictures if picture.name == "mirrors")
    assert {item.label for item in picture.items} > {"0-0", "0-1", "1-0", "1-1"}
    for folder in ("a", "b"):
        write_picture(tmp_path / folder, picture)
    first, second = ((tmp_path / folder / picture.path).read_bytes() for folder in ("a", "b"))
    assert first == second
    image = read_image(tmp_path / "a" / picture.path)
    assert image.shape == (1050, 1400, 3)
    assert (image[:20] == 255).all()
    assert (image[:, :8] == 255).all()
    blue = image[..., 2].astype(int) - image[..., 0] > 30
    assert blue.mean() > 0.05
