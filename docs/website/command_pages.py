"""The reference of the commands, made from their help by cyclopts."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cyclopts import App

from mirrorcam import cli

FOLDER = "reference/commands"
HEADING = re.compile(r"^##(#*) mirrorcam (.+)$", flags=re.MULTILINE)
PAGE = re.compile(r"docs/(\w+)\.md")


def commands(app: App, names: Sequence[str] = cli.NAMES) -> dict[str, App]:
    """Commands and their subcommands, each with its docstring as its help, by the names that follow `mirrorcam`."""
    apps: dict[str, App] = {}
    for name in names:
        cli.show_docstring(app, [name])
        apps[name] = app[name]
        for inner in (inner for inner in app[name] if not inner.startswith("-")):
            cli.show_docstring(app, [name, inner])
            apps[f"{name} {inner}"] = app[name][inner]
            app[name].default_parameter = app.default_parameter  # which cyclopts does not pass on in its documentation
    return apps


def sections() -> dict[str, str]:
    """The help of each command and subcommand in Markdown: usage, text, arguments, options, examples."""
    app = cli.application()
    apps = commands(app)
    parts = HEADING.split(app.generate_docs())
    texts = {}
    for level, name, text in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
        if name not in apps:
            continue  # shell completion
        title, _, examples = (apps[name].help_epilogue or "").removesuffix(cli.CONFIGURED).partition("\n")
        example = f"\n**{title}**\n\n```sh\n{_dedented(examples)}\n```\n" if examples.strip() else ""
        texts[name] = PAGE.sub(r"[\1](../../\1.md)", f"#{level} mirrorcam {name}\n\n{text.strip()}\n{example}")
    return texts


def _dedented(lines: str) -> str:
    return "\n".join(line.strip() for line in lines.strip().splitlines())


def command_pages() -> dict[str, str]:
    """The pages of all commands, with their subcommands, and the list of commands, by name."""
    texts = sections()
    pages = {
        f"{FOLDER}/{name}": "\n".join(text for title, text in texts.items() if title.split()[0] == name)
        for name in cli.NAMES
    }
    rows = [
        f"| [mirrorcam {name}]({name}.md) | {summary} |"
        for commands in cli.COMMANDS.values()
        for name, (_, summary) in commands.items()
    ]
    names = "\n".join(cli.NAMES)
    pages[f"{FOLDER}/index"] = (
        "# Commands and their options\n\n"
        "What `mirrorcam COMMAND --help` prints. [Commands](../../commands.md) has the same list with links to the "
        "guides. Every command also takes `--quiet`, `--verbose` and `--json`, and reads "
        "[defaults of its options](../../commands.md#defaults-and-completion).\n\n"
        "| command | does |\n|---|---|\n" + "\n".join(rows) + f"\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    )
    return pages
