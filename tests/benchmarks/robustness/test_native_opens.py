"""Files that are opened are seen, also by libraries and other processes; others are not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import av
import pytest

from benchmarks.robustness.native_opens import AUDITED, watched_opens

pytestmark = pytest.mark.skipif(not AUDITED, reason="inotify is Linux's")


def test_opens_of_python_libraries_and_processes_are_seen(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("python", "library", "process", "none")]
    for path in paths:
        path.write_bytes(bytes(100))
    with watched_opens(paths) as opened:
        paths[0].read_bytes()
        with pytest.raises(av.FFmpegError):
            av.open(str(paths[1]))
        subprocess.run([sys.executable, "-c", f"open({str(paths[2])!r})"], check=True)
        assert opened == []
    assert sorted(set(opened)) == sorted(paths[:3])
