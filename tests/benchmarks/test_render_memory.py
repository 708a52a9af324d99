"""Memory does not grow with the frames of a set."""

from __future__ import annotations

import mmap
import os
from pathlib import Path

import pytest

from benchmarks.render_memory import main, resident_mib

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs Linux")


@pytest.mark.slow
def test_neither_parent_nor_worker_grows() -> None:
    assert main(frames=1000, scale=0.25, maps=False) == 0


def test_memory_is_seen() -> None:
    before = resident_mib(os.getpid())
    # Pages of its own: an allocator may hand out memory that is resident already.
    held = mmap.mmap(-1, 50 * 2**20)
    held.write(b"x" * len(held))
    assert resident_mib(os.getpid()) - before == pytest.approx(50.0, abs=5.0)
    assert resident_mib(2**22 + 1) == 0.0
    held.close()
