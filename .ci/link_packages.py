"""Make `build/types/mirrorcam`: the package as it is imported, for tools that read files, such as mypy.

The four folders are one import package only once they are installed; a tree of links shows them as that.
Where the system allows no symbolic links, it is a copy, made anew at each call.
"""

import os
import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TREE = ROOT / "build" / "types" / "mirrorcam"
INSIDE = ("optics", "cad", "render_scenes")


def link(place: Path, source: Path) -> None:
    try:
        place.symlink_to(os.path.relpath(source, place.parent), target_is_directory=source.is_dir())
    except OSError:
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, place)


def main() -> None:
    if TREE.exists():
        shutil.rmtree(TREE)
    TREE.mkdir(parents=True)
    for source in (*sorted((ROOT / "src" / "mirrorcam").iterdir()), *(ROOT / name for name in INSIDE)):
        if source.name != "__pycache__":
            link(TREE / source.name, source)


if __name__ == "__main__":
    main()
