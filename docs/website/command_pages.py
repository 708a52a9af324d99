"""The reference of the commands, written from what `mirrorcam COMMAND --help` prints."""

from __future__ import annotations

import io
import os
import re
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, field
from unittest import mock

from mirrorcam import cli

FOLDER = "reference/commands"
WIDTH = 110
"""Columns of the terminal: wide, but not so that groups stand beside each other."""
RULE = re.compile(r"^\s*[-─]{8,}\s*$")
DEFAULT = re.compile(r"\s*\(default: (.*)\)$")
SPECIAL = re.compile(r"([\\*_<>\[\]{}$|#])")
PAGE = re.compile(r"docs/(\w+)\.md")
NAME = re.compile(r"(?:[\w-]+\.[a-z]+|list|mitsuba|new|overlap|smoke)\b")
"""A first word that is a file or a value, and thus no word of a sentence."""
TITLES = {
    "positional arguments": "Arguments",
    "spec options": "What is designed",
    "common options": "Common to all designs",
}


@dataclass
class Option:
    """An option or argument: how it is written, and what it does."""

    written: str
    text: str = ""


@dataclass
class Group:
    """Options under one title, with what is said of all of them."""

    title: str
    text: str = ""
    options: list[Option] = field(default_factory=list)


@dataclass
class Help:
    """What the help of a command says."""

    usage: str
    summary: list[str]
    groups: list[Group]


def help_text(command: str) -> str:
    """What a command's --help prints on a terminal that shows ASCII alone."""
    printed = io.StringIO()
    with mock.patch.dict(os.environ, COLUMNS=str(WIDTH), NO_COLOR="1"), redirect_stdout(printed), suppress(SystemExit):
        cli.parse([command, "--help"])
    return printed.getvalue()


def read_help(text: str) -> Help:
    """The parts of a help text; raises ValueError where there is none."""
    head, *lines = text.splitlines()
    if not head.startswith("usage: "):
        raise ValueError(f"{head!r}, expected the usage of a command")
    summary: list[str] = []
    groups: list[Group] = []
    for number, line in enumerate(lines):
        words = line.strip()
        if not words or RULE.match(line):
            if RULE.match(line) and groups and groups[-1].options:
                # What stood above a second rule of a group is about all of it.
                groups[-1].text = " ".join(filter(None, (f"{o.written} {o.text}".strip() for o in groups[-1].options)))
                groups[-1].options = []
        elif number + 1 < len(lines) and RULE.match(lines[number + 1]) and not line.startswith("  "):
            groups.append(Group(words))
        elif not groups:
            summary.append(words)
        elif line.startswith("   "):
            groups[-1].options[-1].text += (" " if groups[-1].options[-1].text else "") + words
        else:
            written, _, said = words.partition("  ")
            groups[-1].options.append(Option(written, said.strip()))
    return Help(head.removeprefix("usage: "), summary, groups)


def in_markdown(text: str) -> str:
    """A text of the help, in which only names in backticks are marked, with links to pages that it names."""
    parts = text.split("`")
    parts[::2] = [PAGE.sub(r"[\1](../../\1.md)", SPECIAL.sub(r"\\\1", part)) for part in parts[::2]]
    return "`".join(parts) if len(parts) % 2 else SPECIAL.sub(r"\\\1", text)


def _option_lines(option: Option) -> list[str]:
    found = DEFAULT.search(option.text)
    said, default = (option.text[: found.start()], found[1]) if found else (option.text, "")
    said = in_markdown(said if NAME.match(said) else said[:1].upper() + said[1:])
    said += "" if said.endswith(".") else "."
    if default not in ("", "False", "None"):
        said += f" Default: `{default}`."
    return ["", f":::{{option}} {option.written}", said, ":::"]


def page(command: str) -> str:
    """The page of one command."""
    found = read_help(help_text(command))
    lines = [f"# mirrorcam {command}", "", *(f"{in_markdown(line)}\n" for line in found.summary)]
    lines += ["```text", found.usage, "```", "", f"```{{program}} mirrorcam {command}", "```"]
    for group in found.groups:
        options = [option for option in group.options if option.written not in ("-h, --help", "--debug")]
        if options:
            title = TITLES.get(group.title, group.title.removesuffix(" options").capitalize())
            lines += ["", f"## {title}", "", in_markdown(group.text)]
            for option in options:
                lines += _option_lines(option)
    return "\n".join(lines) + "\n"


def command_pages() -> dict[str, str]:
    """The pages of all commands and the list of them, by name."""
    written = {f"{FOLDER}/{command}": page(command) for command in cli.COMMANDS}
    rows = [
        f"| [mirrorcam {command}]({command}.md) | {in_markdown(read_help(help_text(command)).summary[0])} |"
        for command in cli.COMMANDS
    ]
    names = "\n".join(cli.COMMANDS)
    written[f"{FOLDER}/index"] = (
        "# Commands and their options\n\n"
        "These pages are what `mirrorcam COMMAND --help` prints. [Commands by task](../../commands.md) shows which "
        "command to use when, with examples. Every command also takes `--debug`, which shows the traceback of an "
        "error.\n\n"
        "| command | does |\n|---|---|\n" + "\n".join(rows) + f"\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    )
    return written
