"""What tests of several packages share."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

if find_spec("mirrorcam.optics") is None:
    sys.exit('The checkout is not installed. Run: pip install -e ".[all,dev]"')

from mirrorcam.optics.geometry.layout import Layout

ROOT = Path(__file__).parent.parent


def pytest_configure(config: pytest.Config) -> None:
    """Give each library of the test workers one thread: with more, they would wait for each other on shared cores.

    It is said to the workers before they start, as libraries read it when they are loaded.
    """
    if config.getoption("dist", "no") != "no":
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
            os.environ.setdefault(variable, "1")


@pytest.fixture(scope="session")
def default_layout() -> Layout:
    """The nominal layout of the default spec: 3 x 3, C920, scale 80 mm, fold 120 deg."""
    return Layout.load(ROOT / "tests" / "data" / "default_layout.json")


@pytest.fixture(scope="session")
def fold_90_layout() -> Layout:
    """The nominal layout of the same spec with a fold of 90 deg, so that views look along y of the rig."""
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
