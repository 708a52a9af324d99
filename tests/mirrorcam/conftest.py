"""What tests of the command share: a small layout, a small rendered set, a browser, and a cluster of this machine."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.design.assess.monte_carlo import Study, study
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from tests.mirrorcam.small_set import small_set_request
from tests.mirrorcam.small_suite import rendered_into, small_suite
from tests.mirrorcam.studio.browser import FLAGS, chromium
from tests.shared import built_once

ROOT = Path(__file__).parents[2]


def _folding_mirror(left: float, right: float) -> Mirror:
    """A mirror at 45 degrees, 80 mm up the axis, turned inwards, cut along image coordinates left..right."""
    normal = np.array([-(left + right) / 2.0, 1.0, -1.0])
    rays = np.array([[left, -0.15, 1], [right, -0.15, 1], [right, 0.15, 1], [left, 0.15, 1]])
    outline = rays * (80.0 * normal[2] / (rays @ normal))[:, None]
    return Mirror.from_plane(np.array([0.0, 0.0, 80.0]), normal, outline_in_rig_mm=outline)


@pytest.fixture(scope="session")
def small_layout() -> Layout:
    """Two mirrors beside each other before a C920."""
    mirrors = (_folding_mirror(-0.3, -0.02), _folding_mirror(0.02, 0.3))
    return Layout(rows=1, cols=2, camera=Camera.c920(), mirrors=mirrors)


@pytest.fixture(scope="session")
def found(default_layout: Layout) -> Study:
    """A small tolerance study of the default layout."""
    return study(default_layout, Tolerances.hobby(), (300.0, 500.0), devices=20)


@pytest.fixture(scope="session")
def set_request(default_layout: Layout) -> SetRequest:
    """A small set of the default layout, by the fast renderer."""
    return small_set_request(default_layout)


@pytest.fixture(scope="session")
def finished_set(set_request: SetRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That set, made in one go by one process, to be read."""
    return built_once(tmp_path_factory, "small_set", lambda out: render_set(set_request, out))


@pytest.fixture(scope="session")
def finished_suite(default_layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small suite, made in one go by one process, to be read."""
    suite = small_suite(default_layout)
    return built_once(tmp_path_factory, "small_suite", lambda out: rendered_into(out, suite))


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """The system's Chromium; tests are skipped where it is not installed."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = chromium()
    if path is None:
        pytest.skip("chromium is not installed")
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield launched
        launched.close()


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A program instead of `python -m mirrorcam` in processes of its own: what it does is in this file, script.py."""
    fake = tmp_path / "python"
    script = f'[ "$1" = -m ] && set -- "{tmp_path}/script.py" "$@"'
    fake.write_text(f'#!/bin/sh\n{script}\nexec {sys.executable} "$@"\n')
    fake.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(fake))
    return tmp_path / "script.py"


def dask(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """A scheduler or a worker of one process and one thread, which dies as a whole."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with (folder / f"{arguments[0]}.log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:], "--no-dashboard"],
            env=environment,
            stdout=log,
            stderr=log,
        )


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of a scheduler, and the processes: the scheduler, then two workers."""
    pytest.importorskip("distributed", reason="a cluster needs the extra cluster")
    folder = tmp_path_factory.mktemp("dask")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    processes = [dask(folder, "scheduler", "--host", address)]
    worker = ("worker", address, "--no-nanny", "--nthreads", "1", "--local-directory", str(folder))
    processes += [dask(folder, *worker) for _ in range(2)]
    try:
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()
