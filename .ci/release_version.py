"""Print the version that this tree releases, or say what disagrees about it, and exit with 1.

`src/mirrorcam/__init__.py` has the version; all else that names it must name the same, and CHANGELOG.md must have a
dated section for it, whose date is that of CITATION.cff.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SEMANTIC = r"(?:0|[1-9]\d*)\.(?:0|[1-9]\d*)\.(?:0|[1-9]\d*)"
DATE = r"\d{4}-\d{2}-\d{2}"


def stated(root: Path, name: str, pattern: str) -> str:
    """What a line of a file says; empty where it has no such line."""
    found = re.search(pattern, (root / name).read_text(encoding="utf-8"), re.MULTILINE)
    return found[1] if found else ""


def disagreements(root: Path) -> list[str]:
    """What does not fit the version, one line each."""
    version = version_of(root)
    wrong = []
    if not re.fullmatch(SEMANTIC, version):
        wrong.append(f"src/mirrorcam/__init__.py: version {version!r}, expected MAJOR.MINOR.PATCH")
    others = {
        "CITATION.cff": rf"^version: ({SEMANTIC})$",
        "ros2/package.xml": rf"<version>({SEMANTIC})</version>",
        "ros2/setup.py": rf'^    version="({SEMANTIC})",$',
    }
    for name, pattern in others.items():
        if (other := stated(root, name, pattern)) != version:
            wrong.append(f"{name}: version {other or 'missing'}, expected {version}")
    section = stated(root, "CHANGELOG.md", rf"^## \[{re.escape(version)}\] - ({DATE})$")
    if not section:
        wrong.append(f"CHANGELOG.md: no section '## [{version}] - YYYY-MM-DD'")
    released = stated(root, "CITATION.cff", rf"^date-released: ({DATE})$")
    if section and released != section:
        wrong.append(f"CITATION.cff: date-released {released or 'missing'}, expected {section} of CHANGELOG.md")
    return wrong


def version_of(root: Path) -> str:
    """The version in the source."""
    return stated(root, "src/mirrorcam/__init__.py", r'^__version__ = "(.*)"$')


def main(root: Path = ROOT) -> None:
    if wrong := disagreements(root):
        sys.exit("\n".join(f"release: {line}" for line in wrong))
    print(version_of(root))


if __name__ == "__main__":
    main()
