"""What tests of several packages share."""

from __future__ import annotations

import ctypes
import functools
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

if find_spec("mirrorcam.optics") is None:
    sys.exit('The checkout is not installed. Run: pip install -e ".[all,dev]"')

from mirrorcam.optics.design.assess.monte_carlo import Study, study
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from tests.shared import built_once
from tests.small_set import small_set_request
from tests.small_suite import rendered_into, small_suite
from tests.studio.browser import FLAGS, chromium

ROOT = Path(__file__).parent.parent
CACHED = type(functools.cache(len))
CACHING = ("mirrorcam.optics.", "mirrorcam.cad.", "mirrorcam.render_scenes.")

settings.register_profile("few", parent=settings.default, max_examples=20, deadline=None)
settings.load_profile("few")


def pytest_configure(config: pytest.Config) -> None:
    """Give each library of the test workers one thread: with more, they would wait for each other on shared cores.

    It is said to the workers before they start, as libraries read it when they are loaded.
    """
    if config.getoption("dist", "no") != "no":
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
            os.environ.setdefault(variable, "1")


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """After each module, drop what it has cached and return freed memory to the system, so that workers stay small."""
    if nextitem is not None and nextitem.path == item.path:
        return
    for name, module in list(sys.modules.items()):
        if module is getattr(item, "module", None) or name.startswith(CACHING):
            for value in list(vars(module).values()):
                if isinstance(value, CACHED):
                    value.cache_clear()
    if sys.platform == "linux":  # glibc keeps what threads have used; musl has no such call
        getattr(ctypes.CDLL(None), "malloc_trim", int)(0)


@pytest.fixture(scope="session")
def default_layout() -> Layout:
    """The nominal layout of the default spec: 3 x 3, C920, scale 80 mm, fold 120 deg."""
    return Layout.load(ROOT / "tests" / "data" / "default_layout.json")


@pytest.fixture(scope="session")
def free_layout() -> Layout:
    """The default layout of version 0.2.0: free outlines of first-surface acrylic, 1 mm; its file states no shape."""
    return Layout.load(ROOT / "tests" / "data" / "free_layout.json")


@pytest.fixture(scope="session")
def fold_90_layout() -> Layout:
    """Free outlines with a fold of 90 deg, so that views look along y of the rig; the file is of version 0.2.0, too."""
    return Layout.load(ROOT / "tests" / "data" / "fold_90_layout.json")


@pytest.fixture(scope="session")
def two_mirror_photos() -> list[Path]:
    """Eight photographs of a checkerboard and two mirrors."""
    return sorted((ROOT / "tests" / "data" / "two_mirror_photos").glob("photo_*.jpg"))


@pytest.fixture(scope="session")
def two_mirror_video() -> Path:
    """200 frames of a checkerboard that a hand moves before two mirrors."""
    return ROOT / "tests" / "data" / "two_mirror_video" / "first_200_frames.mp4"


@pytest.fixture(scope="session")
def foreign_sets() -> Path:
    """The folder of calibration sets that another renderer made, which the project does not ship.

    It is looked for in $MIRRORCAM_FOREIGN_SETS, and in data/foreign_sets of any folder beside the checkout.
    """
    named = os.environ.get("MIRRORCAM_FOREIGN_SETS")
    found = [Path(named)] if named else sorted(ROOT.parent.glob("*/data/foreign_sets"))
    if not found or not (found[0] / "a_ch" / "truth" / "truth.json").is_file():
        pytest.skip("no sets of another renderer in $MIRRORCAM_FOREIGN_SETS or beside the checkout")
    return found[0]


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
def playwright() -> Iterator[Any]:
    """Playwright, of which a process runs one; tests are skipped without it or the system's Chromium."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if chromium() is None:
        pytest.skip("chromium is not installed")
    with sync_api.sync_playwright() as playwright:
        yield playwright


@pytest.fixture(scope="session")
def browser(playwright: Any) -> Iterator[Any]:
    """The system's Chromium."""
    launched = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
    yield launched
    launched.close()


@pytest.fixture(scope="module")
def flat_browser(playwright: Any) -> Iterator[Any]:
    """The system's Chromium without 3-D graphics, in which pages appear sooner."""
    launched = playwright.chromium.launch(executable_path=chromium(), args=[*FLAGS, "--disable-3d-apis"])
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
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(sys.path),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
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
