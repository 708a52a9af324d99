"""Gather the pages of the site in one tree: from docs/, generated from the code, and for the files that they link to.

Pages in docs/ are also readable on a code host, where links lead to any file of the repository. On the site, such
a file gets its own page below `repository/`, and a folder gets a list of its files.
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
"""Pages of the site for Markdown files outside docs/, and for the files that its front page replaces."""
FENCE = re.compile(r"^( *)(`{3,}|:{3,}).*?^\1\2 *$", flags=re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(!?)\[([^\]\n]*(?:\n[^\]\n]+)?)\]\(([^)\s#]*)(#[^)\s]*)?\)")
PAGE_NAME = re.compile(r"`?[\w/]+\.md`?")
LANGUAGES = {".py": "python", ".toml": "toml", ".json": "json", ".xml": "xml", ".cff": "yaml"}
TEXT_SUFFIXES = (*LANGUAGES, ".md", "")
"""Suffixes of the text files of a folder, which are listed."""


def outside_code(text: str, change: Callable[[str], str]) -> str:
    """Apply a change to the text of a page outside code fences."""
    parts, end = [], 0
    for fence in FENCE.finditer(text):
        if fence[2].startswith("`"):
            parts += [change(text[end : fence.start()]), fence[0]]
            end = fence.end()
    return "".join([*parts, change(text[end:])])


def page_of(path: str) -> str:
    """The page of the site for a file or folder of the repository, without its suffix."""
    if path in DOCUMENTS:
        return DOCUMENTS[path]
    file = PurePosixPath(path)
    if file.suffix == ".md" and file.is_relative_to(f"{WEBSITE}/pages"):
        return file.relative_to(f"{WEBSITE}/pages").with_suffix("").as_posix()
    if file.suffix == ".md" and file.parts[0] == "docs":
        return file.relative_to("docs").with_suffix("").as_posix()
    return f"repository/{path}"


class PageTree:
    """A tree of pages that is being written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.linked: set[str] = set()

    def write(self, page: str, text: str) -> None:
        """Write a page by its name, without suffix."""
        path = self.folder / f"{page}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def add(self, path: str) -> None:
        """Add a Markdown file of the repository, with its links changed to the pages of their targets."""
        page = page_of(path)
        text = (ROOT / path).read_text(encoding="utf-8")
        if page == "index" and not (ROOT / "docs/gallery.md").exists():
            text = text.replace("\ngallery\n", "\n")  # it is generated separately
        self.write(page, outside_code(text, lambda part: LINK.sub(lambda link: self._link(link, path, page), part)))

    def _link(self, link: re.Match[str], path: str, page: str) -> str:
        picture, text, target, anchor = link[1], link[2], link[3], link[4] or ""
        if ":" in target or not target:
            return link[0]
        to = os.path.normpath(Path(path).parent / target)
        if not (ROOT / to).exists():
            return link[0]  # a generated page, or a dead link, which Sphinx reports
        if to.startswith("docs/") and not to.endswith(".md"):
            new_target = to.removeprefix("docs/")  # pictures and schemas keep their paths
        else:
            new_target = f"{page_of(to)}.md"
            if new_target.startswith("repository/"):
                self.linked.add(to)
        if PAGE_NAME.fullmatch(text):
            text = ""  # Sphinx inserts the title
        return f"{picture}[{text}]({os.path.relpath(new_target, Path(page).parent)}{anchor})"

    def add_linked(self) -> None:
        """Add a page for every file and folder of the repository that a page links to."""
        for path in sorted(self.linked):
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
    """Names of the text files directly in a folder of the repository."""
    files = (file for file in sorted((ROOT / folder).iterdir()) if file.is_file() and file.suffix in TEXT_SUFFIXES)
    return [file.name for file in files if file.stat().st_size < 200_000]


def gather(folder: Path, generated: dict[str, str]) -> None:
    """Fill an empty folder with the pages of the site; `generated` holds the pages generated from the code, by name."""
    tree = PageTree(folder)
    docs = ROOT / "docs"
    for path in sorted(docs.rglob("*.md")):
        relative = path.relative_to(ROOT).as_posix()
        if relative != "docs/README.md":
            tree.add(relative)
    for relative in ("CONTRIBUTING.md", "CHANGELOG.md", "ros2/README.md"):
        tree.add(relative)
    for page, text in generated.items():
        tree.write(page, text)
    tree.add_linked()
    for path in sorted((*docs.rglob("*.json"), *docs.rglob("*.toml"))):
        target = folder / path.relative_to(docs)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
    if (docs / "images").is_dir():
        shutil.copytree(docs / "images", folder / "images")
