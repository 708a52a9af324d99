"""The whole way in small: one command from nothing to a page, and a second run that finds it all done."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam.calibration.validation import calibrate_set
from mirrorcam.core.disk.fingerprint import file_digests, value_digest
from mirrorcam.core.disk.output_folder import HIDDEN, output_folder
from mirrorcam.core.disk.stages import made_of
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.run.pipeline import SETTINGS, finish, quick_recipe, stages
from tests.shared import path_without_slicer

pytestmark = pytest.mark.slow

STAGES = ("design", "cad", "set", "validation", "light_field", "page")


def run_quick(out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mirrorcam", "run", "--quick", "--out", str(out)]
    environment = os.environ | {"PATH": path_without_slicer()}
    return subprocess.run(
        command, cwd=out.parent, capture_output=True, text=True, timeout=600, check=False, env=environment
    )


def reused(result: subprocess.CompletedProcess[str]) -> set[str]:
    """The stages that a run found done."""
    return {line.split()[0] for line in result.stdout.splitlines() if "reused" in line}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """The folder of a first run, and what it said."""
    if find_spec("build123d") is None or find_spec("mitsuba") is None:
        pytest.skip("the whole way needs the extras cad and render")
    out = tmp_path_factory.mktemp("output") / "quick"
    return out, run_quick(out)


def test_it_ends_well_and_says_so_in_plain_lines(first: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    out, result = first
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stderr == ""
    assert "\x1b" not in result.stdout
    assert reused(result) == set()
    assert [path.name for path in out.iterdir() if path.name.startswith(".")] == [HIDDEN]
    assert sorted(path.name for path in (out / HIDDEN).iterdir()) == ["results", "written.jsonl"]


def test_every_link_of_the_page_leads_to_a_file(first: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    out, _ = first
    page = (out / "index.html").read_text()
    targets = re.findall(r'(?:href|src)="([^"]+)"', page)
    assert len(targets) >= 12
    assert [target for target in targets if not (out / target).is_file()] == []
    assert "checks pass" in page


def test_metrics_hold_value_unit_and_limit(first: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    out, _ = first
    metrics = json.loads((out / "metrics.json").read_text())
    assert {name.split(".")[0] for name in metrics} == {"design", "cad", "validation"}
    assert all({"value", "unit"} <= set(metric) for metric in metrics.values())
    assert metrics["validation.normal_error_max_deg"]["value"] <= metrics["validation.normal_error_max_deg"]["limit"]


def test_the_calibrator_needs_no_truth(first: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    out, _ = first
    for part in ("frames", "base", "dataset.json", "layout.json", "board.toml"):
        source = out / "set" / part
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / part)
    assert calibrate_set(tmp_path).layout == Layout.load(out / "validation" / "layout.json")


def test_a_second_run_reuses_every_stage(first: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    out, _ = first
    before = {stage: file_digests(out / stage) for stage in STAGES}
    page = (out / "index.html").read_text()
    result = run_quick(out)
    assert result.returncode == 0
    assert reused(result) == set(STAGES)
    after = {stage: file_digests(out / stage) for stage in STAGES}
    assert after == before
    assert (out / "index.html").read_text() == page


def test_a_deleted_file_is_made_again_and_nothing_else(first: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    out, _ = first
    tiles = next((out / "light_field").glob("*_views.png"))
    before = tiles.read_bytes()
    tiles.unlink()
    result = run_quick(out)
    assert result.returncode == 0
    assert reused(result) == set(STAGES) - {"light_field"}
    assert f"done again: {tiles.name} is missing" in result.stdout
    assert tiles.read_bytes() == before


def test_an_interrupted_run_leaves_whole_stages_and_goes_on(
    first: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    out = tmp_path / "quick"
    for stage in ("design", "cad", HIDDEN):
        shutil.copytree(first[0] / stage, out / stage)
    (of_set,) = (stage for stage in stages(quick_recipe(seed=0), out) if stage.name == "set")
    unfinished = out / HIDDEN / "unfinished" / "set" / value_digest(made_of(of_set, out))
    command = [sys.executable, "-m", "mirrorcam", "run", "--quick", "--out", str(out)]
    environment = os.environ | {"PATH": path_without_slicer()}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as running:
        while not (unfinished / "frames" / f"0002{SETTINGS.suffix}").exists():
            assert running.poll() is None, running.communicate()
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        said, complaint = running.communicate(timeout=60)
    assert running.returncode == 130
    assert complaint == "mirrorcam: interrupted; finished files are complete\n"
    assert {line.split()[0] for line in said.splitlines() if "reused" in line} == {"design", "cad"}
    assert not (out / "set").exists()
    frames = {path.name: path.stat().st_mtime_ns for path in (unfinished / "frames").glob(f"*{SETTINGS.suffix}")}
    assert len(frames) >= 3

    with output_folder(out, "run") as output:
        finish(of_set, output)
    now = {name: (out / "set" / "frames" / name).stat().st_mtime_ns for name in frames}
    assert now == frames
    assert file_digests(out / "set") == file_digests(first[0] / "set")
