"""The documentation: every command in it can be parsed, every link and picture in it exists."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from cyclopts import CycloptsError

from docs.page_code import blocks
from mirrorcam.cli import application
from mirrorcam.core.command_text import command_text

ROOT = Path(__file__).parents[1]
DOCS = [path for path in sorted((ROOT / "docs").rglob("*.md")) if "website" not in path.parts]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS]
"""Pages of the repository; the site's own ones are checked where it is built."""


def command_lines(text: str) -> list[str]:
    """The `mirrorcam` command lines of a page's shell blocks, without comments and what stands for something else."""
    parts = [
        part.strip()
        for block in blocks(text, "sh")
        for command, _ in block.commands
        for part in re.split(r"&&|\|\|", command)
    ]
    return [part for part in parts if part.startswith("mirrorcam ") and "…" not in part]


def links(text: str) -> list[str]:
    """Targets of a page's links and pictures that are files of this project."""
    targets = re.findall(r"\]\(([^)#\s]+)", text)
    return [target for target in targets if "://" not in target]


def is_parsed(line: str) -> bool:
    """Return whether the command line accepts a command with its options."""
    arguments = [word for word in shlex.split(line)[1:] if word not in ("--quiet", "--json", "--verbose")]
    try:
        with command_text():
            application().parse_args(arguments)
    except CycloptsError:
        return False
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_of_a_page_can_be_parsed(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lines = command_lines(page.read_text(encoding="utf-8"))
    assert [line for line in lines if not is_parsed(line)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_of_a_page_leads_to_a_file(page: Path) -> None:
    missing = [target for target in links(page.read_text(encoding="utf-8")) if not (page.parent / target).exists()]
    assert missing == []


def test_commands_and_links_are_found() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "mirrorcam run" in command_lines(readme)
    assert "docs/measured.md" in links(readme)
    assert not is_parsed(*command_lines("```sh\nmirrorcam depth a.npz --no-such 1   # a comment\n```\n"))
