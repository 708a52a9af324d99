"""How fast the studio's page answers: from the pointer to the picture, from the release to the exact design.

    python -m benchmarks.studio

Needs Chromium and playwright. A limit stands beside each figure: what the studio is to reach on two cores.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from mirrorcam.console.progress import print_metrics, say
from mirrorcam.optics.base.values import Metric
from tests.mirrorcam.studio.browser import FLAGS, WIDE, Watched, browser_page, chromium, served

STEPS, STEP_S = 60, 0.05
"""Inputs of a slider that is dragged, and the time between them."""
SLIDERS = {"scale_mm": (4.382, 4.787), "fold_deg": (120.0, 108.0), "tradeoff": (0.3, 0.6), "spacing_mm": (1.0, 2.5)}
"""Where each slider is dragged from and to (scale: logarithm of mm)."""
DRAG = """
async ([name, from, to, steps, wait]) => {
  const range = document.querySelector(`[data-name="${name}"] input[type=range]`);
  for (let i = 1; i <= steps; i += 1) {
    range.value = from + ((to - from) * i) / steps;
    range.dispatchEvent(new Event("input", { bubbles: true }));
    await new Promise((resolve) => setTimeout(resolve, wait));
  }
  await new Promise((resolve) => setTimeout(resolve, 500));
  const found = performance.getEntriesByName("preview").map((entry) => entry.duration);
  performance.clearMeasures("preview");
  range.dispatchEvent(new Event("change", { bubbles: true }));
  return found;
}
"""


def solve_ms(page: Watched) -> float:
    """The time of the newest exact design, from the request to its answer."""
    found: float = page.page.evaluate("performance.getEntriesByName('solve').at(-1).duration")
    return found


def dragged(page: Watched, name: str) -> tuple[list[float], float]:
    """Times from each input of a slider to its picture, and of the exact design after the release, ms."""
    start, end = SLIDERS[name]
    times = page.page.evaluate(DRAG, [name, start, end, STEPS, 1e3 * STEP_S])
    page.page.wait_for_selector("#status.exact", timeout=60_000)
    return times, solve_ms(page)


def measured(browser: Any) -> dict[str, Metric]:
    """All figures."""
    figures: dict[str, Metric] = {}
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        with served(Path(folder)) as address, browser_page(browser, WIDE) as page:
            listening = time.monotonic() - began
            page.open(address)
            page.page.wait_for_selector("#sensor path.mirror")
            figures["start_to_first_picture"] = Metric(value=time.monotonic() - began, unit="s", limit=2.0)
            figures["start_to_listening"] = Metric(value=listening, unit="s")
            page.settled()
            size = page.page.evaluate("performance.getEntriesByType('navigation')[0].decodedBodySize")
            figures["page"] = Metric(value=size / 1e6, unit="MB")
            for count in (3, 5):
                page.page.get_by_role("spinbutton", name="Rows, number").fill(str(count))
                page.page.keyboard.press("Enter")
                page.page.wait_for_selector("#status.exact", timeout=60_000)
                page.page.get_by_role("spinbutton", name="Columns, number").fill(str(count))
                page.page.keyboard.press("Enter")
                page.page.wait_for_selector("#status.exact", timeout=60_000)
                shape, limit = f"{count}x{count}", {3: 1.5, 5: 5.0}[count]
                times: list[float] = []
                solved = []
                for name in SLIDERS:
                    page.page.click("#reset") if count == 3 else None
                    page.page.wait_for_selector("#status.exact", timeout=60_000)
                    some, solve = dragged(page, name)
                    times += some
                    solved.append(solve / 1e3)
                    say(
                        "studio",
                        f"{shape} {name}: p50 {np.median(some):.0f} ms, p95 {np.quantile(some, 0.95):.0f} ms, "
                        f"{len(some)} pictures, exact {solve / 1e3:.2f} s",
                    )
                figures[f"preview_p50_{shape}"] = Metric(value=float(np.median(times)), unit="ms")
                figures[f"preview_p95_{shape}"] = Metric(value=float(np.quantile(times, 0.95)), unit="ms", limit=150.0)
                figures[f"exact_after_release_{shape}"] = Metric(value=max(solved), unit="s", limit=limit)
    return figures


def main() -> int:
    """Print the figures."""
    path = chromium()
    if path is None:
        print("chromium is not installed", file=sys.stderr)
        return 2
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        print_metrics({"measured": measured(browser)})
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
