"""Attempts with odd names notice where a guard is missing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness import names
from benchmarks.robustness.guard import run_monitored
from mirrorcam.core.disk import fingerprint


def wrong(use: Callable[[Path, np.random.Generator], str], monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(names, "USES", (use,))
    return " ".join(run_monitored(names.attempt, seed) for seed in range(60))


def unchecked(folder: Path, name: str) -> Path:
    return folder / name


def test_reading_outside_of_a_folder_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "dataset" not in wrong(names.dataset, monkeypatch)
    monkeypatch.setattr(fingerprint, "inside", unchecked)
    assert "dataset read a file outside of the folder" in wrong(names.dataset, monkeypatch)
