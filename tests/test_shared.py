"""Fixtures that several workers share: built once, whoever asks, and never seen half made."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.shared import built_once


def test_all_workers_get_one_folder_that_is_built_once(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    base, calls = tmp_path / "run", []
    for worker in ("gw0", "gw1"):
        (base / worker).mkdir(parents=True)

    def build(folder: Path) -> None:
        calls.append(folder)
        folder.mkdir()
        time.sleep(0.1)
        (folder / "file.txt").write_text("whole")

    monkeypatch.setenv("PYTEST_XDIST_WORKER", "gw0")
    monkeypatch.setattr(tmp_path_factory, "getbasetemp", lambda: base / "gw0")
    with ThreadPoolExecutor(max_workers=2) as pool:
        folders = [job.result() for job in [pool.submit(built_once, tmp_path_factory, "x", build) for _ in range(2)]]
    monkeypatch.setattr(tmp_path_factory, "getbasetemp", lambda: base / "gw1")
    folders.append(built_once(tmp_path_factory, "x", build))
    assert folders == [base / "shared" / "x"] * 3
    assert len(calls) == 1
    assert (folders[0] / "file.txt").read_text() == "whole"


def test_a_build_that_fails_leaves_no_folder(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tmp_path_factory, "getbasetemp", lambda: tmp_path)
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)

    def fails(folder: Path) -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        built_once(tmp_path_factory, "x", fails)
    assert built_once(tmp_path_factory, "x", lambda folder: folder.mkdir()).is_dir()
