"""The page of a device: one HTML file with the assembly in 3-D, which works offline, opened from disk."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from itertools import pairwise
from pathlib import Path

from markdown_it import MarkdownIt
from markupsafe import Markup

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.assembly_guide import is_sliced, masses_of
from mirrorcam.cad.guide.device_pictures import central_ray
from mirrorcam.cad.guide.picture_views import DevicePicture
from mirrorcam.cad.plan.device_names import COUPON, UNMOUNTED
from mirrorcam.cad.plan.part_plan import LICENCE, BuiltPart
from mirrorcam.cad.plan.prices import summary_of
from mirrorcam.core.disk.files import read_bytes, write_text
from mirrorcam.core.figures.figure_texts import label_text, sentence_case
from mirrorcam.core.html.templates import FigureTable, PageFile, render
from mirrorcam.core.names import anchor_of
from mirrorcam.core.values import Metric

WEB = Path(__file__).parents[1] / "web"
PURPOSES = (
    ("assembly.step", "the assembled device, for any CAD program"),
    ("assembly.glb", "the assembled device, for viewers and game engines"),
    ("plates/*.3mf", "printed together, with print settings"),
    ("plates/*.ini", "the print settings, for PrusaSlicer and SuperSlicer"),
    ("plates/*.json", "the print settings, for OrcaSlicer and Bambu Studio"),
    ("mirrors/mirrors*.dxf", "the mirrors, for a laser cutter"),
    ("mirrors/mirrors*.svg", "the mirrors, for a laser cutter that reads SVG"),
    ("mirrors/scale_bar.*", "a bar of 100 mm, to check a cutter's scale"),
    ("mirrors/cutting.md", "notes for the cutter, with a list of rectangles"),
    ("robot/*.xacro", "the device on the robot's arm, as a macro"),
    ("robot/*.urdf", "the device for a robot, with its camera and views"),
    ("bom.csv", "the parts list, for a spreadsheet"),
    ("bom.json", "the parts list, for a program"),
    ("bom.md", "the parts list, to read"),
    ("guide.md", "the assembly guide, to print"),
    ("source/*", "what all files here are made from"),
    ("NOTICE.txt", "the licence of the device"),
    ("checks.json", "every check and figure, with its value, unit and limit"),
)


def write_page(
    folder: Path,
    device: Device,
    parts: Sequence[BuiltPart],
    plates: Mapping[str, Sequence[str]],
    pictures: Sequence[DevicePicture],
    checks: Mapping[str, Metric],
) -> None:
    """Write index.html into `folder`, which contains assembly.glb, bom.md, guide.md and all linked files.

    `plates` has the names of the parts on each plate, by its file's path in the folder. The model is embedded in the
    page, since browsers do not load files from disk; pictures and other files are linked.
    """
    layout = device.layout
    views = len(layout.mirrors) if layout.pattern else f"{layout.rows} by {layout.cols}"
    failed = [name for name, metric in checks.items() if not metric.passed]
    limited = sum(metric.limit is not None for metric in checks.values())
    not_checked = device.hardware.back.not_checked
    rays = [central_ray(layout, i).round(3).tolist() for i in range(len(layout.mirrors))]
    page = render(
        WEB,
        "page.html",
        title=f"A light field camera with {views} views",
        lead=(
            f"{len(layout.mirrors)} flat mirrors turn a {device.hardware.camera.name} into "
            f"{views} cameras. This page has everything needed to print, cut and assemble them."
        ),
        summary=summary_of(checks),
        identity=layout.identity,
        licence=LICENCE,
        parts=parts,
        masses=masses_of(parts),
        sliced=is_sliced(parts),
        pictures=pictures,
        others=_other_files(folder, parts, plates),
        guide=_html(_text(folder / "guide.md")),
        # The guide is on the same page.
        bom=_html(_text(folder / "bom.md").replace("(guide.md#", "(#")),
        failed=failed,
        verdict=(
            f"{len(failed)} of {limited} checks failed: do not make this device"
            if failed
            else f"all {limited} checks pass" + (f"; not checked: {not_checked}" if not_checked else "")
        ),
        check_groups=_groups(checks, parts),
        data=Markup(json.dumps({"rays_mm": rays, "not_shown": _not_shown(parts)})),
        glb=base64.b64encode(read_bytes(folder / "assembly.glb")).decode(),
    )
    write_text(folder / "index.html", page)


def _html(text: str) -> Markup:
    """Markdown as HTML, without any HTML of its own; headings have the anchors that links lead to."""
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = markdown.parse(text)
    for heading, content in pairwise(tokens):
        if heading.type == "heading_open":
            title = "".join(child.content for child in content.children or ())
            heading.attrSet("id", anchor_of(title))
    return Markup(markdown.renderer.render(tokens, markdown.options, {}))


def _text(path: Path) -> str:
    return read_bytes(path).decode("utf-8")


def _other_files(folder: Path, parts: Sequence[BuiltPart], plates: Mapping[str, Sequence[str]]) -> list[PageFile]:
    """The files of the device other than those of parts, with their purposes; `checks.json` is written later."""
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} | {"checks.json"}
    return [
        PageFile(name, _on_plate(plates[name], purpose, parts) if name in plates else purpose)
        for pattern, purpose in PURPOSES
        for name in sorted(names)
        if fnmatch(name, pattern)
    ]


def _on_plate(names: Sequence[str], purpose: str, parts: Sequence[BuiltPart]) -> str:
    """The numbers and titles of the parts on a plate, its purpose, and the part to print first."""
    title_of = {part.name: f"{part.number} {part.title}" for part in parts}
    titles = ", ".join(title_of[name] for name in names)
    coupon = next((part for part in parts if part.name == COUPON), None)
    first = f"; {coupon.number} {coupon.title} comes first, alone, from its own file" if coupon else ""
    return f"{titles}: {purpose}{first}"


def _not_shown(parts: Sequence[BuiltPart]) -> str:
    """A sentence about the printed parts that the model lacks, since they are not mounted in use; "" for none."""
    unmounted = [f"{part.number} {part.title}" for part in parts if part.name in UNMOUNTED]
    return f"Not in the model, since they are not mounted in use: {', '.join(unmounted)}" if unmounted else ""


def _groups(checks: Mapping[str, Metric], parts: Sequence[BuiltPart]) -> list[tuple[str, FigureTable]]:
    """Tables of checks, grouped by the object that prefixes their names; the device comes first."""
    titles = {part.name: f"{part.number} {part.title}" for part in parts}
    groups: dict[str, dict[str, Metric]] = {}
    for name, metric in checks.items():
        group, dot, rest = name.partition(".")
        title = titles.get(group, sentence_case(label_text(group))) if dot else "Device"
        groups.setdefault(title, {})[rest if dot else name] = metric
    tables = [(title, FigureTable.of(metrics)) for title, metrics in groups.items()]
    return sorted(tables, key=lambda item: item[0] in titles.values())
