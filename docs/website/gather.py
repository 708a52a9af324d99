"""The pages of the site in one tree: those of docs/, those written from the code, and the files that they link to.

Pages in docs/ read as they are on a code host, where links lead to any file of the repository. On the site, such a file
gets a page of its own, below `repository/`, and a folder a list of its files.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
WEBSITE = "docs/website"
DOCUMENTS = {
    "CONTRIBUTING.md": "contributing",
    "CHANGELOG.md": "changelog",
    "ros2/README.md": "ros2",
    "README.md": "index",
    "docs/README.md": "index",
}
"""Markdown files outside docs/ that are pages of the site, and those that its front page stands for."""
FENCE = re.compile(r"^( *)(`{3,}|:{3,}).*?^\1\2 *$", flags=re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(!?)\[([^\]\n]*(?:\n[^\]\n]+)?)\]\(([^)\s#]*)(#[^)\s]*)?\)")
NAME_OF_A_PAGE = re.compile(r"`?[\w/]+\.md`?")
LANGUAGES = {".py": "python", ".toml": "toml", ".json": "json", ".xml": "xml", ".cff": "yaml"}
SHOWN = (*LANGUAGES, ".md", "")
"""Endings of the files of a folder that are shown: texts."""


def outside_code(text: str, change: Callable[[str], str]) -> str:
    """A page with its text changed, but not what is in fences."""
    parts, end = [], 0
    for fence in FENCE.finditer(text):
        if fence[2].startswith("`"):
            parts += [change(text[end : fence.start()]), fence[0]]
            end = fence.end()
    return "".join([*parts, change(text[end:])])


def page_of(path: str) -> str:
    """Where the site has a file or folder of the repository, without the ending."""
    if path in DOCUMENTS:
        return DOCUMENTS[path]
    inside = PurePosixPath(path)
    if inside.suffix == ".md" and inside.is_relative_to(f"{WEBSITE}/pages"):
        return inside.relative_to(f"{WEBSITE}/pages").with_suffix("").as_posix()
    if inside.suffix == ".md" and inside.parts[0] == "docs":
        return inside.relative_to("docs").with_suffix("").as_posix()
    return f"repository/{path}"


class Gathered:
    """A tree of pages in the making."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.wanted: set[str] = set()

    def write(self, page: str, text: str) -> None:
        """Write a page by its name, without the ending."""
        path = self.folder / f"{page}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def add(self, path: str) -> None:
        """Add a Markdown file of the repository, with its links turned to where the site has their targets."""
        page = page_of(path)
        text = (ROOT / path).read_text(encoding="utf-8")
        if page == "index" and not (ROOT / "docs/gallery.md").exists():
            text = text.replace("\ngallery\n", "\n")  # it is made apart
        self.write(page, outside_code(text, lambda part: LINK.sub(lambda link: self._turned(link, path, page), part)))

    def _turned(self, link: re.Match[str], path: str, page: str) -> str:
        picture, text, target, anchor = link[1], link[2], link[3], link[4] or ""
        if ":" in target or not target:
            return link[0]
        to = os.path.normpath(Path(path).parent / target)
        if not (ROOT / to).exists():
            return link[0]  # a page that is written from the code, or a dead link, which Sphinx names
        if to.startswith("docs/") and not to.endswith(".md"):
            there = to.removeprefix("docs/")  # pictures and schemas keep their places
        else:
            there = f"{page_of(to)}.md"
            if there.startswith("repository/"):
                self.wanted.add(to)
        if NAME_OF_A_PAGE.fullmatch(text):
            text = ""  # Sphinx puts the title there
        return f"{picture}[{text}]({os.path.relpath(there, Path(page).parent)}{anchor})"

    def add_wanted(self) -> None:
        """Add a page for every file and folder of the repository that a page links to."""
        for path in sorted(self.wanted):
            for name in self._with_files(path):
                self._show(name)

    def _with_files(self, path: str) -> Iterator[str]:
        yield path
        if (ROOT / path).is_dir():
            yield from (f"{path}/{name}" for name in _files(path))

    def _show(self, path: str) -> None:
        title = f"---\norphan: true\n---\n\n# `{path}`\n\n"
        if (ROOT / path).is_dir():
            name = PurePosixPath(path).name
            lines = [f"- [{file}]({name}/{file}.md)" for file in _files(path)]
            self.write(page_of(path), title + "\n".join(lines) + "\n")
            return
        language = LANGUAGES.get(Path(path).suffix, "text")
        text = (ROOT / path).read_text(encoding="utf-8").rstrip()
        self.write(page_of(path), f"{title}``````{language}\n{text}\n``````\n")


def _files(folder: str) -> list[str]:
    """Names of the texts directly in a folder of the repository."""
    every = sorted((ROOT / folder).iterdir())
    return [each.name for each in every if each.is_file() and each.suffix in SHOWN and each.stat().st_size < 200_000]


def gather(folder: Path, written: dict[str, str]) -> None:
    """Fill an empty folder with the pages of the site; `written` holds those from the code, by their names."""
    tree = Gathered(folder)
    docs = ROOT / "docs"
    for path in sorted(docs.rglob("*.md")):
        relative = path.relative_to(ROOT).as_posix()
        if relative != "docs/README.md":
            tree.add(relative)
    for relative in ("CONTRIBUTING.md", "CHANGELOG.md", "ros2/README.md"):
        tree.add(relative)
    for page, text in written.items():
        tree.write(page, text)
    tree.add_wanted()
    for path in sorted((*docs.rglob("*.json"), *docs.rglob("*.toml"))):
        place = folder / path.relative_to(docs)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, place)
    if (docs / "images").is_dir():
        shutil.copytree(docs / "images", folder / "images")
