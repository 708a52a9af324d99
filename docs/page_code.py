"""Run the code of pages as a reader does, from first line to last: `python -m docs.page_code PAGE... --work FOLDER`.

Blocks run in order in one folder: `sh` in bash, `python` as a program. A `toml` block that begins with a file name in
a comment is written to that file. A shell line does not run if it ends with `# needs ...`, such as a camera or the
network, or if such a comment stands above it.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(r"^```(sh|python|toml)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
LINE = re.compile(r"^[ \t]*(.*?)[ \t]*(?:(?<!\S)#(.*))?$", flags=re.MULTILINE)
"""A line of a shell block: its command and its comment."""
NEEDS = " needs "
FILE_NAME = re.compile(r"# (\S+\.toml)\n")


@dataclass(frozen=True)
class Block:
    """A block of code of a page; `language` is sh, python or toml."""

    language: str
    text: str

    @property
    def commands(self) -> list[tuple[str, str]]:
        """Each command line of a shell block, without its comment, and what it needs ("" if nothing)."""
        found, needs = [], ""
        for command, comment in LINE.findall(self.text):
            if comment.startswith(NEEDS):
                needs = comment.removeprefix(NEEDS)
            if command:
                found.append((command, needs))
                needs = ""
        return found

    def run(self, folder: Path) -> None:
        """Run the block in a folder.

        Raises
        ------
        subprocess.CalledProcessError
            If a command or the program fails.
        """
        if self.language == "toml":
            if name := FILE_NAME.match(self.text):
                (folder / name[1]).write_text(self.text, encoding="utf-8")
            return
        script = "\n".join(command for command, needs in self.commands if not needs)
        program = [sys.executable, "-c", self.text] if self.language == "python" else ["bash", "-euc", script]
        path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
        subprocess.run(program, cwd=folder, env=os.environ | {"PATH": path}, check=True)


def blocks(text: str, language: str | None = None) -> list[Block]:
    """Blocks of a page's text in order, of all three languages or of one."""
    found = [Block(*groups) for groups in BLOCK.findall(text)]
    return [block for block in found if language in (None, block.language)]


def run_page(page: Path, folder: Path) -> None:
    """Run all blocks of a page in a folder, and print each with its duration."""
    for block in blocks(page.read_text(encoding="utf-8")):
        print(block.text, flush=True)
        start = time.monotonic()
        block.run(folder)
        print(f"{page.name}: {time.monotonic() - start:.1f} s\n", flush=True)


def main() -> None:
    """Run pages, each in a folder of its own."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("pages", type=Path, nargs="+", metavar="PAGE")
    parser.add_argument("--work", type=Path, required=True, metavar="FOLDER")
    options = parser.parse_args()
    for page in options.pages:
        folder = options.work / page.stem
        folder.mkdir(parents=True, exist_ok=True)
        run_page(page, folder)


if __name__ == "__main__":
    main()
