"""mrcal in a separate interpreter: where it is installed, its lens models, and the solver's answers."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

SOLVER = Path(__file__).with_name("mrcal_solver.py")
LENSES = {"brown_conrady": "LENSMODEL_OPENCV5", "rational": "LENSMODEL_OPENCV8", "thin_prism": "LENSMODEL_OPENCV12"}


def python_with_mrcal(requested: str | None) -> str | None:
    """Return an interpreter that has mrcal; None if there is none."""
    for python in (requested,) if requested else (sys.executable, "/usr/bin/python3"):
        try:
            subprocess.run([python, "-c", "import mrcal"], capture_output=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            continue
        return python
    return None


def run_solver(python: str, task: dict[str, Any]) -> dict[str, Any]:
    """Run the solver in a separate interpreter, and return its answer."""
    with tempfile.TemporaryDirectory() as folder:
        request, answer = Path(folder) / "task.json", Path(folder) / "answer.json"
        request.write_text(json.dumps(task))
        subprocess.run([python, str(SOLVER), str(request), str(answer)], check=True)
        return dict(json.loads(answer.read_text()))
