"""`python -m benchmarks.robustness [CATEGORY ...] [--part 0.01] [--seed 0]`: the table of all categories."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

from benchmarks.robustness.guard import Category, lines, tally
from mirrorcam.core.processes.worker_pool import cores

MODULES = ("files", "names", "media", "playlists", "light_fields")


def categories() -> dict[str, Category]:
    """Return all categories by name."""
    modules = (import_module(f"benchmarks.robustness.{name}") for name in MODULES)
    groups = (getattr(module, "CATEGORIES", None) or (module.CATEGORY,) for module in modules)
    return {category.name: category for group in groups for category in group}


def main() -> int:
    all_categories = categories()
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robustness", description=__doc__)
    parser.add_argument("category", nargs="*", choices=[*all_categories, []], default=[])
    parser.add_argument("--part", type=float, default=1.0, help="fraction of the attempts of the full table")
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    options = parser.parse_args()
    tallies = []
    for name in options.category or all_categories:
        count = max(round(options.part * all_categories[name].count), 1)
        tallies.append(tally(all_categories[name], range(options.seed, options.seed + count), cores()))
    print("\n".join(lines(tallies)))
    return 1 if any(result.wrong for result in tallies) else 0


if __name__ == "__main__":
    sys.exit(main())
