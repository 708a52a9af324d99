"""Print for which Pythons and systems every dependency of each extra has a wheel, as the table of docs/installing.md.

Needs uv (pip install uv) and a package registry; nothing is downloaded but metadata. What lacks a wheel somewhere is
named by the resolver, and listed below the table.

    python .ci/wheel_matrix.py [options for uv, such as --offline, of what it has fetched before]
"""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
# By uv's names, with the oldest macOS that the libraries still build for.
SYSTEMS = {
    "Linux x86-64": "x86_64-manylinux_2_28",
    "Linux ARM64": "aarch64-manylinux_2_28",
    "macOS 14 ARM64": "aarch64-apple-darwin",
    "macOS 14 x86-64": "x86_64-apple-darwin",
    "Windows x86-64": "x86_64-pc-windows-msvc",
}
OLDEST_MACOS = "14.0"


def lacking(system: str, python: str, extra: str) -> str:
    """What the resolver names first as without a wheel; empty where all have one."""
    command = ["uv", "pip", "compile", "--no-config", "--quiet", "--only-binary", ":all:", "--python-platform", system]
    command += [
        "--python-version",
        python,
        *(["--extra", extra] if extra else []),
        str(ROOT / "pyproject.toml"),
        *sys.argv[1:],
    ]
    surroundings = os.environ | {"MACOSX_DEPLOYMENT_TARGET": OLDEST_MACOS}
    done = subprocess.run(command, capture_output=True, text=True, env=surroundings, check=False)
    if not done.returncode:
        return ""
    named = re.search(r"Because (?:all versions of )?([\w.-]+)", done.stderr)
    named = re.search(r"([\w.-]+?)(?:[<>=!][^ ]*)? has no usable wheels", done.stderr.replace("\n", " ")) or named
    if named is None:
        sys.exit(f"{extra or 'base'} on {system}, Python {python}: {done.stderr}")
    return named[1]


def main() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = ["", *(extra for extra in project["optional-dependencies"] if extra != "dev")]
    print(f"| extra | {' | '.join(SYSTEMS)} |\n|---|{'---|' * len(SYSTEMS)}")
    notes = []
    for extra in extras:
        cells = []
        for title, system in SYSTEMS.items():
            missing = {python: lacking(system, python, extra) for python in PYTHONS}
            with_all = [python for python, name in missing.items() if not name]
            cells.append("all" if len(with_all) == len(PYTHONS) else ", ".join(with_all) or "none")
            for name in sorted({name for name in missing.values() if name}):
                pythons = ", ".join(python for python, each in missing.items() if each == name)
                notes.append(f"- `{extra or 'base'}` on {title}, Python {pythons}: no wheel of {name}")
        print(f"| {f'`{extra}`' if extra else 'base'} | {' | '.join(cells)} |", flush=True)
    print("\n" + "\n".join(notes))


if __name__ == "__main__":
    main()
