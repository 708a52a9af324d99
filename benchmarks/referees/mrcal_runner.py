"""mrcal in another interpreter: where it is, which lenses it has, and its answers."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

SOLVER = Path(__file__).with_name("mrcal_solver.py")
LENSES = {"brown_conrady": "LENSMODEL_OPENCV5", "rational": "LENSMODEL_OPENCV8", "thin_prism": "LENSMODEL_OPENCV12"}


def python_with_mrcal(asked: str | None) -> str | None:
    """An interpreter that has mrcal; None where there is none."""
    for python in (asked,) if asked else (sys.executable, "/usr/bin/python3"):
        try:
            subprocess.run([python, "-c", "import mrcal"], capture_output=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            continue
        return python
    return None


def asked(python: str, task: dict[str, Any]) -> dict[str, Any]:
    """What the solver answers in another interpreter."""
    with tempfile.TemporaryDirectory() as kept:
        given, answer = Path(kept) / "task.json", Path(kept) / "answer.json"
        given.write_text(json.dumps(task))
        subprocess.run([python, str(SOLVER), str(given), str(answer)], check=True)
        return dict(json.loads(answer.read_text()))
