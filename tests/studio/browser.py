"""A real browser that looks at pages of the studio, and watches that they behave."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from mirrorcam.core.errors import InputError

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
# No graphics card: 3-D graphics by software, and the page drawn without them, which is ten times as fast. Nothing that
# talks to the maker's servers.
FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run"),
)
WIDE, NARROW = (1400, 950), (390, 844)
SHIFTS = """
window.shifts = [];
new PerformanceObserver((list) => {
  for (const entry of list.getEntries()) {
    if (!entry.hadRecentInput) {
      const name = ({ node }) => node?.id || node?.className || node?.nodeName;
      window.shifts.push([entry.value, ...entry.sources.map(name)]);
    }
  }
}).observe({ type: "layout-shift", buffered: true });
"""


def chromium() -> str | None:
    """The system's Chromium, None where there is none."""
    return next((path for name in CHROMIUM if (path := shutil.which(name))), None)


@dataclass
class Watched:
    """A page, and what went wrong on it: errors, messages of its console, requests to other places."""

    page: Any
    errors: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)

    def open(self, address: str) -> None:
        """Go to an address, from which on the page may fetch from the same place alone."""
        own = address.split("/", 3)[:3]

        def asked(request: Any) -> None:
            if request.url.split("/", 3)[:3] != own and not request.url.startswith(("data:", "blob:")):
                self.outside.append(request.url)

        self.page.on("request", asked)
        self.page.goto(address)

    def settled(self) -> None:
        """Wait until the newest request is solved, or refused."""
        self.page.wait_for_selector("#status.exact, #status.failed", timeout=60_000)

    def shifts(self) -> list[list[Any]]:
        """Layout shifts that no one caused by a click or a key: size, and what moved."""
        found: list[list[Any]] = self.page.evaluate("window.shifts")
        return found

    @property
    def status(self) -> str:
        """What the page says of the design."""
        return str(self.page.inner_text("#status"))

    @property
    def drawn(self) -> dict[str, Any]:
        """The drawing that the page shows."""
        found: dict[str, Any] = self.page.evaluate("Studio.designer.state.drawing")
        return found


@contextmanager
def browser_page(
    browser: Any, size: tuple[int, int] = WIDE, scheme: Literal["light", "dark"] = "light", **context: Any
) -> Iterator[Watched]:
    """A new page of a browser, without what others have stored."""
    width, height = size
    opened = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme, **context)
    opened.add_init_script(SHIFTS)
    watched = Watched(opened.new_page())
    watched.page.on("pageerror", lambda error: watched.errors.append(str(error)))
    watched.page.on("console", lambda message: _note(watched, message))
    try:
        yield watched
    finally:
        opened.close()


# Of the software renderer; and answers that refuse what was asked for, which the page shows.
EXPECTED = ("GPU stall due to ReadPixels", "status of 422")


def _note(watched: Watched, message: Any) -> None:
    if message.type in ("error", "warning") and not any(text in message.text for text in EXPECTED):
        watched.errors.append(message.text)


@contextmanager
def served(folder: Path, command: str = "studio", *arguments: str, errors: Path | None = None) -> Iterator[str]:
    """The address of a page that a command serves in a process of its own, which ends with 0 where it is asked to.

    What it writes to standard error goes to a file, where one is given.
    """
    given = [command, *arguments, "--no-browser", "--port", "0", "--out", str(folder)]
    with ExitStack() as files:
        process = subprocess.Popen(
            [sys.executable, "-m", "mirrorcam", *given],
            stdout=subprocess.PIPE,
            stderr=None if errors is None else files.enter_context(errors.open("w", encoding="utf-8")),
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
    assert process.stdout is not None
    line = process.stdout.readline()
    if "http" not in line:
        raise InputError(f"mirrorcam {command} printed {line!r}, expected its address")
    try:
        yield line.split()[1]
    finally:
        process.send_signal(signal.SIGTERM)  # jobs in the background of a script ignore Ctrl-C
        assert process.wait(20) == 0
