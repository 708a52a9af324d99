"""How fast the studio's page answers: from the pointer to the picture, from the release to the exact design.

    python -m benchmarks.studio [--json FILE]

Needs Chromium and playwright. A limit stands beside each figure: what the studio is to reach on two cores.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from benchmarks.records import TIMES, Table, add_json_option, table, write_record
from mirrorcam.core.console.progress import print_metrics, say
from mirrorcam.core.values import Metric
from tests.studio.browser import FLAGS, WIDE, Watched, browser_page, chromium, served

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


STARTS = 3
COUNTS = (3, 5)
LIMITS_S = {3: 1.5, 5: 5.0}


def first_picture_s(browser: Any) -> float:
    """The time from a start of the studio to its first picture."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        with served(Path(folder)) as address, browser_page(browser, WIDE) as page:
            page.open(address)
            page.page.wait_for_selector("#sensor path.mirror")
            return time.monotonic() - began


def measured(browser: Any) -> tuple[dict[str, Metric], dict[int, list[float]]]:
    """All figures, and the seconds of exact designs after each release, by the rows of mirrors."""
    figures: dict[str, Metric] = {}
    exact: dict[int, list[float]] = {}
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
            for count in COUNTS:
                page.page.get_by_role("spinbutton", name="Rows, number").fill(str(count))
                page.page.keyboard.press("Enter")
                page.page.wait_for_selector("#status.exact", timeout=60_000)
                page.page.get_by_role("spinbutton", name="Columns, number").fill(str(count))
                page.page.keyboard.press("Enter")
                page.page.wait_for_selector("#status.exact", timeout=60_000)
                shape, limit = f"{count}x{count}", LIMITS_S[count]
                times: list[float] = []
                solved = exact.setdefault(count, [])
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
    return figures, exact


def tabled(figures: dict[str, Metric], exact: dict[int, list[float]]) -> Table:
    """Times of previews and of exact designs; what exceeds its limit is bold."""
    previews, slowest, others = [], [], []
    for count in COUNTS:
        median, most = (figures[f"preview_{name}_{count}x{count}"].value for name in ("p50", "p95"))
        previews.append(f"{median:.0f} / {most:.0f} ms")
        *rest, last = sorted(exact[count])
        slowest.append(f"**{last:.1f} s**" if last > LIMITS_S[count] else f"{last:.1f} s")
        others.append(f"{rest[0]:.1f} to {rest[-1]:.1f} s")
    limits = ", ".join(f"{LIMITS_S[count]:g}" for count in COUNTS)
    rows = [
        ("from an input to the picture of the preview, median / 95 %", *previews, "150 ms"),
        (
            f"from the release to the exact design, slowest of four (the others: {', '.join(others)})",
            *slowest,
            f"{limits} s",
        ),
    ]
    return table(("", *(f"{count} {TIMES} {count}" for count in COUNTS), "limit"), rows)


def main(json: Path | None) -> int:
    """Print the figures."""
    path = chromium()
    if path is None:
        print("chromium is not installed", file=sys.stderr)
        return 2
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        figures, exact = measured(browser)
        starts = [figures["start_to_first_picture"].value, *(first_picture_s(browser) for _ in range(STARTS - 1))]
        print_metrics({"measured": figures})
        browser.close()
    recorded = {"first_picture_least_s": min(starts), "first_picture_most_s": max(starts)}
    write_record(json, "studio", recorded | {"page_mb": figures["page"].value}, tabled(figures, exact))
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_json_option(parser)
    sys.exit(main(parser.parse_args().json))
