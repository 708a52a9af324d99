"""The page of a device: one HTML file that works from disk and offline, with the assembly in 3-D."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markdown_it import MarkdownIt

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.documents.device_pictures import DevicePicture, middle_ray
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.optics.base.files import read_bytes, write_text
from mirrorcam.optics.base.values import Metric

WEB = Path(__file__).parents[1] / "web"
PURPOSES = (
    ("assembly.step", "the assembled device, for any CAD program"),
    ("assembly.glb", "the assembled device, for viewers and game engines"),
    ("mirrors/*.dxf", "the mirrors, for a laser cutter"),
    ("mirrors/*.svg", "the mirrors, for a laser cutter that reads SVG"),
    ("robot/*.xacro", "the device on the robot's arm, as a macro"),
    ("robot/*.urdf", "the device for a robot, with its camera and views"),
    ("bom.csv", "the parts list, for a spreadsheet"),
    ("bom.json", "the parts list, for a program"),
    ("bom.md", "the parts list, to read"),
    ("guide.md", "the assembly guide, to print"),
    ("checks.json", "every check with its value, unit and limit"),
)
_WORDS = {"bom": "parts list", "stl": "STL", "step": "STEP", "3mf": "3MF", "dxf": "DXF"}


@dataclass(frozen=True)
class _Row:
    """A check as the page says it."""

    name: str
    value: str
    limit: str
    verdict: str
    failed: bool


def write_page(
    folder: Path,
    device: Device,
    parts: Sequence[BuiltPart],
    pictures: Sequence[DevicePicture],
    checks: Mapping[str, Metric],
) -> None:
    """Write index.html into `folder`, which holds assembly.glb, bom.md, guide.md and all that the page links to.

    The model travels in the page (a browser reads no file from disk by itself), pictures and files lie beside it.
    """
    layout = device.layout
    markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
    environment = Environment(
        loader=FileSystemLoader(WEB), autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True
    )
    count = f"{layout.rows} by {layout.cols}"
    page = environment.get_template("page.html").render(
        title=f"A light field camera with {count} views",
        lead=(
            f"{len(layout.mirrors)} flat mirrors turn a {device.hardware.camera.name} into {count} cameras. Here is "
            "everything to print, cut and assemble one."
        ),
        identity=layout.identity,
        parts=parts,
        mass={part.name: _mass(part) for part in parts},
        sliced=all("print_g" in part.checks for part in parts),
        pictures=pictures,
        others=_other_files(folder),
        guide=markdown.render(_text(folder / "guide.md")),
        bom=markdown.render(_text(folder / "bom.md")),
        limited=sum(metric.limit is not None for metric in checks.values()),
        failed=[name for name, metric in checks.items() if not metric.passed],
        check_groups=_groups(checks, parts),
        data=json.dumps({"rays_mm": [middle_ray(layout, i).round(3).tolist() for i in range(len(layout.mirrors))]}),
        glb=base64.b64encode(read_bytes(folder / "assembly.glb")).decode(),
        css=_text(WEB / "page.css"),
        three=_text(WEB / "three.bundle.js"),
        script=_text(WEB / "page.js"),
    )
    write_text(folder / "index.html", page)


def _mass(part: BuiltPart) -> str:
    """Grams as the slicer says, or of the solid where there is no slicer."""
    return f"{part.checks['print_g'].value if 'print_g' in part.checks else part.mass.mass_g:.0f}"


def figure_text(value: float) -> str:
    """A measured figure as people read it: four significant digits, all of thousands, no long tails."""
    if abs(value) >= 1000.0:
        return f"{value:.0f}"
    return f"{value:.4g}" if value == 0.0 or abs(value) >= 1e-4 else f"{value:.1e}"


def _text(path: Path) -> str:
    return read_bytes(path).decode("utf-8")


def _other_files(folder: Path) -> list[tuple[str, str]]:
    """The files of the device beside those of its parts, with what they are for; the checks are written last."""
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} | {"checks.json"}
    return [(name, purpose) for pattern, purpose in PURPOSES for name in sorted(names) if fnmatch(name, pattern)]


def _groups(checks: Mapping[str, Metric], parts: Sequence[BuiltPart]) -> list[tuple[str, list[_Row]]]:
    """Checks by what they are of, which their names begin with; the device as a whole comes first."""
    titles = {part.name: f"{part.number} {part.title}" for part in parts}
    groups: dict[str, list[_Row]] = {}
    for name, metric in checks.items():
        group, dot, rest = name.partition(".")
        title = titles.get(group, _words(group)) if dot else "Device"
        groups.setdefault(title, []).append(_row(rest if dot else name, metric))
    return sorted(groups.items(), key=lambda item: item[0] in titles.values())


def _row(name: str, metric: Metric) -> _Row:
    unit = f" {metric.unit}" if metric.unit else ""
    limit = (
        "" if metric.limit is None else f"{'≤' if metric.lower_is_better else '≥'} {figure_text(metric.limit)}{unit}"
    )
    verdict = "" if metric.limit is None else "passes" if metric.passed else "FAILS"
    return _Row(_words(name), f"{figure_text(metric.value)}{unit}", limit, verdict, not metric.passed)


def _words(name: str) -> str:
    """A check's name as people read it, without the unit, which stands by the figure."""
    words = name.replace(".", ": ").split("_")
    if len(words) > 1 and words[-1] in {"mm", "mm2", "mm3", "cm3", "um", "deg", "g"}:
        words = words[:-1]
    text = " ".join(_WORDS.get(word, word) for word in words)
    return text[:1].upper() + text[1:]
