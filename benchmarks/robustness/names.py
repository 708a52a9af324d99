"""Names from other people's files: manifests, records and journals that list odd files, and names of cameras.

A secret lies beside the folder that is read: nothing may read it or write beside it. Names of cameras must be text in
every page.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from markdown_it import MarkdownIt

from benchmarks.robustness.damage import damaged_bytes, damaged_value
from benchmarks.robustness.guard import Category, refused_well
from mirrorcam.cad.guide.assembly_guide import camera_toml
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.write.bill_files import as_csv, as_markdown
from mirrorcam.cad.write.bill_of_materials import Bom, BoughtLine
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.disk.fingerprint import digest
from mirrorcam.core.disk.output_folder import output_folder, results_folder
from mirrorcam.core.disk.results import Results
from mirrorcam.core.disk.stages import Stage, made_of, staleness
from mirrorcam.core.names import markdown_text
from mirrorcam.core.values import InputError
from mirrorcam.optics.camera_files.write import write_exports
from mirrorcam.optics.geometry.camera_body import CameraBody
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.io.recording import Folders, Recording
from mirrorcam.simulation.set_check import check_set
from tests.render_scenes.manifests import dataset_of_two_frames, scene_of_two_depths

LAYOUT = Path(__file__).parents[2] / "tests" / "data" / "default_layout.json"
SECRET, SECRET_TEXT = "secret", "nobody's business"
MINE = "mine"
ODD_NAMES = (
    *(
        "../secret",
        "..\\secret",
        "./../secret",
        "frames/../../secret",
        "link/secret",
        "deep/link",
        "/etc/passwd",
        "C:\\x",
    ),
    *(
        "",
        ".",
        "..",
        "a\x00b",
        "a\nb",
        "x" * 300,
        "x/" * 3000,
        "\u202e",
        "con",
        "-rf",
        "~",
        "$HOME",
        "mine",
        "{secret}",
    ),
)
ODD_TEXTS = (
    *("<img src=x onerror=alert(1)>", "</code></pre><script>alert(1)</script>", "=1+1", "+1", "-1", "@SUM(A1)", "\t=1"),
    *(
        "a|b",
        "[a](javascript:alert(1))",
        "`x`",
        "```",
        "'; --",
        '"/><b',
        "a\nb: c",
        "{{ 7 * 7 }}",
        "$\\frac$",
        "\x1b[2J",
    ),
    *("]]>", "-->", "&lt;b&gt;", "x" * 5000, "\u2028", "<b", "![a](b)"),
    *("", " ", "\"a\" 'b'", "../../secret", "Spiegel ä 鏡 🪞", "x" * 300, "\ud800", "\uff1d1+1"),
)


def attempt(seed: int, folder: Path) -> str:
    """Use a manifest or a profile with odd names, and look at what that read, wrote and said."""
    random = np.random.default_rng(seed)
    place = folder / "place"
    (place / "deep").mkdir(parents=True)
    (folder / SECRET).write_text(SECRET_TEXT)
    (place / MINE).write_text(MINE)
    (place / "link").symlink_to(folder)
    (place / "deep" / "link").symlink_to(folder / SECRET)
    use = USES[int(random.integers(len(USES)))]
    with _opened() as opened:
        try:
            wrong = use(place, random)
        except InputError as error:
            wrong = refused_well(str(error).replace(str(folder), ""))
    if opened & {str((folder / SECRET).resolve()), os.path.realpath("/etc/passwd")}:
        return f"{use.__name__} read a file outside of the folder"
    if (folder / SECRET).read_text() != SECRET_TEXT or {path.name for path in folder.iterdir()} != {"place", SECRET}:
        return f"{use.__name__} wrote outside of the folder"
    if not (place / MINE).exists() or (place / MINE).read_text() != MINE:
        return f"{use.__name__} lost a file"
    return wrong and f"{use.__name__}: {wrong}"


_seen: list[set[str]] = []


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and _seen and isinstance(arguments[0], str | bytes):
        _seen[-1].add(os.path.realpath(os.fsdecode(arguments[0])))


@cache
def _watch() -> None:
    sys.addaudithook(_note)


@contextmanager
def _opened() -> Iterator[set[str]]:
    """The files that are opened in the block."""
    _watch()
    _seen.append(set())
    try:
        yield _seen[-1]
    finally:
        _seen.pop()


def _odd(values: tuple[str, ...], random: np.random.Generator, folder: Path) -> str:
    return values[int(random.integers(len(values)))].replace("{secret}", str(folder.parent / SECRET))


def _files(folder: Path, random: np.random.Generator) -> dict[str, str]:
    """One to three odd names, with the true checksum of the secret or of the user's own file."""
    whole = digest(SECRET_TEXT.encode()), digest(MINE.encode())
    names = [_odd(ODD_NAMES, random, folder) for _ in range(int(random.integers(1, 4)))]
    return {name: str(random.choice(whole)) for name in names}


def _put(path: Path, value: Any, random: np.random.Generator) -> None:
    """Write JSON, sometimes with damaged values or bytes."""
    kind = random.random()
    text = json.dumps(damaged_value(value, random) if kind < 0.3 else value)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(damaged_bytes(text.encode(), random) if kind > 0.85 else text.encode())


def dataset(folder: Path, random: np.random.Generator) -> str:
    """Verify a rendered set."""
    _put(
        folder / "dataset.json",
        dataset_of_two_frames().replaced(files=_files(folder, random)).model_dump(mode="json", by_alias=True),
        random,
    )
    check_set(folder)
    return ""


def resumed(folder: Path, random: np.random.Generator) -> str:
    """Go on with a rendered set or scene."""
    manifest = dataset_of_two_frames() if random.random() < 0.5 else scene_of_two_depths()
    listed = manifest.replaced(files=_files(folder, random))
    _put(folder / manifest.FILE, listed.model_dump(mode="json", by_alias=True), random)
    if random.random() < 0.3:
        (folder / "truth").symlink_to(folder.parent)
    manifest.continued(folder, ("layout.json", "frames/0000.jpg"))
    return ""


def stage(folder: Path, random: np.random.Generator) -> str:
    """Look whether a stage of a run is done."""
    step = Stage("design", lambda place, progress: None)
    (folder / "design").mkdir()
    files = {name: sha256.encode() for name, sha256 in _files(folder, random).items()}
    Results(results_folder(folder)).put("stage-design", made_of(step, folder), files)
    staleness(step, folder)
    return ""


def record(folder: Path, random: np.random.Generator) -> str:
    """Write into a folder whose record lists files of others."""
    files = {name: value for name, value in _files(folder, random).items() if name != MINE}
    line = {"schema": "mirrorcam.written/2", "command": "cad", "files": {name: [files[name]] for name in files}}
    _put(folder / ".mirrorcam" / "written.jsonl", line, random)
    with output_folder(folder, "cad", force=bool(random.random() < 0.5)) as output:
        output.refuse_changed()
        with output.staged() as staged:
            (staged / "new").write_text("new")
    return ""


def journal(folder: Path, random: np.random.Generator) -> str:
    """Go on with a recording, or look at one that is finished."""
    frames: list[Any] = [{"number": number, "time_s": 0.1 * number} for number in range(3)]
    odd = {"number": _odd(ODD_NAMES, random, folder), "time_s": 0.0}
    frames.insert(int(random.integers(4)), odd if random.random() < 0.5 else damaged_value(frames[0], random))
    about = {"schema": "mirrorcam.light_field/1"}
    if random.random() < 0.5:
        lines = "".join(json.dumps(line) + "\n" for line in (about, *frames)).encode()
        (folder / "clip.partial").mkdir()
        (folder / "clip.partial" / "journal.jsonl").write_bytes(
            damaged_bytes(lines, random) if random.random() < 0.3 else lines
        )
    else:
        _put(folder / "clip" / "frames.json", {**about, "frames": frames, "lost": []}, random)
    Recording(folder / "clip", about, Folders(lambda place, light_field: None)).close()
    return ""


@cache
def _layout() -> Any:
    return json.loads(LAYOUT.read_bytes())


def layout(folder: Path, random: np.random.Generator) -> str:
    """Export the cameras of a layout whose camera has an odd name."""
    value = {**_layout(), "camera": {**_layout()["camera"], "name": _odd(ODD_TEXTS, random, folder)}}
    (folder / "layout.json").write_text(json.dumps(value), encoding="utf-8")
    read = Layout.load(folder / "layout.json")
    if random.random() < 0.03:  # a second each
        write_exports(read, folder / "cameras")
        return _raw((folder / "cameras" / "README.md").read_text(encoding="utf-8"))
    return ""


def profile(folder: Path, random: np.random.Generator) -> str:
    """Write the name of a camera of a profile as the documents of a device do."""
    body = read_body("c920").model_dump(mode="json") | {"name": _odd(ODD_TEXTS, random, folder)}
    back = {"kind": "none"}
    if random.random() < 0.3:
        back = {"kind": "gen2", "name": _odd(ODD_TEXTS, random, folder), "link": _odd(ODD_TEXTS, random, folder)}
    (folder / "hardware.json").write_text(json.dumps({"camera": body, "back": back}))
    camera = read_model(Hardware, folder / "hardware.json").camera
    (folder / "camera.toml").write_text(camera_toml(camera), encoding="utf-8")
    if read_model(CameraBody, folder / "camera.toml") != camera:
        return f"the profile of {camera.name!r} is not read as it was written"
    line = BoughtLine(title=camera.name, count=1, note="the camera")
    bill = Bom(
        layout_identity="0",
        plastic=camera.name,
        plastic_g=1.0,
        sliced=False,
        printed=(),
        mirrors=(),
        bought=(line,),
        currency=camera.name,
        prices_date=camera.name,
        price=0.0,
        unpriced=(line.title,),
    )
    if any(cell.startswith(("=", "+", "-", "@", "\t")) for cell in as_csv(bill).split(",")):
        return f"{camera.name!r} is a formula in the parts list"
    return _raw(as_markdown(bill)) or _raw(f"# Guide\n\nFor a {markdown_text(camera.name)}.\n")


class _Tags(HTMLParser):
    """The tags of a page that no table or text has."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("img", "script", "b") or any(name.startswith("on") or "javascript" in str(v) for name, v in attrs):
            self.found.append(tag)


def _raw(markdown: str) -> str:
    """Find markup that a name makes in Markdown, where it is read with and without HTML; empty for plain text."""
    for raw in (True, False):
        found = _Tags(MarkdownIt("commonmark", {"html": raw}).enable("table").render(markdown)).found
        if found:
            return f"a page has the tag {found[0]}"
    return "a page has a raw tag" if "<img" in markdown or "<script" in markdown else ""


USES: tuple[Callable[[Path, np.random.Generator], str], ...] = (
    *(dataset, resumed, stage, record, journal, layout, profile),
)
CATEGORY = Category("names and manifests", 3_000, attempt)
