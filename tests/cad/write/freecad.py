"""FreeCAD without its window, as an independent reader of STEP files."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

PROGRAMS = ("freecadcmd", "FreeCADCmd")
CAD_PAGE = Path(__file__).parents[3] / "docs" / "cad.md"
# Without merge=False, version 0.20.2 merges an assembly's solids, and crashes later.
LISTED = """
import FreeCAD, Import, Part

def listed(path, document):
    Import.insert(name=path, docName=document.Name, merge=False)
    return [about(thing) for thing in document.Objects]

def about(thing):
    labels = {"label": thing.Label, "within": [other.Label for other in thing.InList]}
    if thing.isDerivedFrom("App::LinkGroup"):
        return labels | {"kind": "Group"}
    shape = Part.getShape(thing)
    return labels | {
        "kind": shape.ShapeType,
        "solids": len(shape.Solids),
        "closed": [shell.isClosed() for shell in shape.Shells],
        "valid": shape.isValid(),
        "volume": shape.Volume,
        "centre": list(shape.CenterOfGravity),
    }
"""
"""Defines `listed(path, document)`, which reads a STEP file: of every object in FreeCAD's tree what is above."""


def find_freecad() -> str | None:
    """FreeCAD's program without a window, if it is installed."""
    return next((path for name in PROGRAMS if (path := shutil.which(name))), None)


def run_in_freecad(script: str, folder: Path) -> Any:
    """The variable `found` at the end of a script that FreeCAD runs in a folder, passed as JSON."""
    program = find_freecad()
    assert program is not None
    end = "\nimport json\nwith open('found.json', 'w') as file:\n    json.dump(found, file)\n"
    (folder / "script.py").write_text(script + end, encoding="utf-8")
    # FreeCAD's own Python, without a user's settings.
    kept = {name: text for name, text in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    home = {"HOME": str(folder), "FREECAD_USER_HOME": str(folder), "LC_ALL": "C.UTF-8"}
    run = subprocess.run(
        [program, "script.py"],
        check=False,
        cwd=folder,
        env=kept | home,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (folder / "found.json").is_file(), run.stdout[-1000:] + run.stderr[-1000:]
    return json.loads((folder / "found.json").read_text(encoding="utf-8"))


def script_of_the_page() -> str:
    """The script that docs/cad.md gives to users of FreeCAD."""
    blocks = CAD_PAGE.read_text(encoding="utf-8").split("```python\n")[1:]
    (script,) = (block.partition("```")[0] for block in blocks if "import FreeCAD" in block)
    return script
