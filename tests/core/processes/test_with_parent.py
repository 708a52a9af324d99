"""A process that imports the module ends with the one that started it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.core.processes.processes import ended, first_line

CHILD = """
import os, sys, time
import mirrorcam.core.processes.with_parent
open(sys.argv[1], "w").write(f"{os.getpid()}\\n")
time.sleep(300)
"""
PARENT = "import subprocess, sys; subprocess.run([sys.executable, '-c', *sys.argv[1:]])"


@pytest.mark.skipif(sys.platform != "linux", reason="on Linux only")
def test_a_process_ends_with_its_parent(tmp_path: Path) -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT, CHILD, str(tmp_path / "pid")])
    child = int(first_line(tmp_path / "pid"))
    assert not ended(child, within_s=0.0)
    parent.kill()
    parent.wait()
    assert ended(child)
