"""Commands that a page starts: their progress and end, and that they can be cancelled."""

from __future__ import annotations

import os
import time
import zipfile
from pathlib import Path
from typing import Any

import pytest

from mirrorcam.cad.plan.back_table import BACKS
from mirrorcam.core.errors import InputError
from mirrorcam.designs.design_files import read_request
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.jobs import JobReport, Jobs, calibration_plan, folder_name, plan, progress, write_folder, zipped

SCRIPT = """
import sys, time
print("parts        1/4 steps after 1 s", flush=True)
{}
"""


def ended(jobs: Jobs) -> JobReport:
    for _ in range(300):
        report = jobs.reports()[0]
        if report.state != "running":
            return report
        time.sleep(0.05)
    raise AssertionError("the job does not end")


def test_a_job_reports_its_progress_and_its_page(scripted: Path, tmp_path: Path) -> None:
    jobs = Jobs(tmp_path)
    page = tmp_path / "d" / "parts" / "index.html"
    page.parent.mkdir(parents=True)
    page.touch()
    scripted.write_text(SCRIPT.format("time.sleep(0.5)"))
    started = jobs.start(plan(tmp_path, "parts", "d"))
    assert started.state == "running"
    assert started.page == ""
    for _ in range(100):
        if jobs.reports()[0].progress is not None:
            break
        time.sleep(0.02)
    assert jobs.reports()[0].progress == 0.25
    done = ended(jobs)
    assert (done.state, done.progress, done.page) == ("done", 1.0, "d/parts/index.html")
    assert done.command.startswith("mirrorcam cad ")


def test_progress_is_that_of_all_steps_and_never_falls() -> None:
    lines = [f"{name:12} step {k} of 2, its work ..." for k, name in ((1, "cad"), (2, "set"))]
    counts = [f"{name:12} {done}/4 frames after 9 s" for name in ("cad", "set") for done in (1, 3)]
    log = [lines[0], *counts[:2], "cad          done in 9.0 s", lines[1], *counts[2:]]
    shares = [share for k in range(1, len(log) + 1) if (share := progress(log[:k])[1]) is not None]
    assert shares == [0.0, 0.125, 0.375, 0.375, 0.5, 0.625, 0.875]
    assert progress(log) == ("step 2 of 2: set, 3 of 4", 0.875)
    assert progress(["mirrorcam"]) == ("", None)


def test_only_the_newest_job_of_a_folder_offers_files_and_a_result_only_once_complete(
    scripted: Path, tmp_path: Path
) -> None:
    jobs, folder = Jobs(tmp_path), tmp_path / "d" / "run"
    (folder / "cad").mkdir(parents=True)
    for name in ("index.html", "cad/index.html"):
        (folder / name).write_text("before")
    scripted.write_text("import time; time.sleep(60)")
    jobs.start(plan(tmp_path, "run", "d"))
    jobs.cancel(1)
    cancelled = ended(jobs)
    assert (cancelled.page, cancelled.bytes) == ("d/run/cad/index.html", 12)
    scripted.write_text("")
    jobs.start(plan(tmp_path, "run", "d"))
    assert ended(jobs).page == "d/run/index.html"
    older = jobs.reports()[1]
    assert (older.page, older.bytes) == ("", 0)


def test_a_job_that_fails_says_so_with_its_last_words(scripted: Path, tmp_path: Path) -> None:
    jobs = Jobs(tmp_path)
    scripted.write_text(SCRIPT.format('sys.exit("mirrorcam: no space")'))
    jobs.start(plan(tmp_path, "run", "d"))
    failed = ended(jobs)
    assert failed.state == "failed"
    assert failed.lines[-1] == "mirrorcam: no space"


def test_one_job_of_a_kind_works_on_a_design_and_can_be_cancelled(scripted: Path, tmp_path: Path) -> None:
    jobs = Jobs(tmp_path)
    scripted.write_text(SCRIPT.format("time.sleep(60)"))
    jobs.start(plan(tmp_path, "set", "d"))
    with pytest.raises(InputError, match="already"):
        jobs.start(plan(tmp_path, "set", "d"))
    while not jobs.reports()[0].lines:
        time.sleep(0.02)
    jobs.cancel(1)
    assert ended(jobs).state == "cancelled"
    with pytest.raises(InputError, match="job 9"):
        jobs.cancel(9)
    jobs.start(plan(tmp_path, "set", "d"))
    jobs.close()
    assert ended(jobs).state == "cancelled"


@pytest.mark.parametrize("kind", ["parts", "set", "run"])
def test_commands_write_below_the_folder_of_the_design(kind: Any, tmp_path: Path) -> None:
    made = plan(tmp_path, kind, "d")
    out = made.arguments[made.arguments.index("--out") + 1]
    assert Path(out) == tmp_path / made.folder == tmp_path / "d" / kind


def test_a_calibration_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "calibrations" / "calibration_0001").mkdir(parents=True)
    made = calibration_plan(tmp_path, Path("board.toml"), Path("layout.json"))
    assert made.folder == "calibrations/calibration_0002"


@pytest.mark.parametrize("writes", [True, False])
def test_a_failed_check_of_complete_files_is_an_alarm_and_no_failure(
    writes: bool, scripted: Path, tmp_path: Path
) -> None:
    jobs, page = Jobs(tmp_path), tmp_path / "d" / "run" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("before")
    os.utime(page, (0, 0))
    scripted.write_text(f"import pathlib, sys\nif {writes}: pathlib.Path({str(page)!r}).write_text('new')\nsys.exit(1)")
    jobs.start(plan(tmp_path, "run", "d"))
    assert ended(jobs).state == ("alarm" if writes else "failed")


@pytest.mark.parametrize("adapter", BACKS)
def test_the_adapter_is_passed_to_the_commands_that_build_the_device(adapter: Any, tmp_path: Path) -> None:
    for kind in ("parts", "run"):
        arguments = plan(tmp_path, kind, "d", adapter).arguments
        assert arguments[arguments.index("--adapter") + 1] == adapter
    assert "--adapter" not in plan(tmp_path, "set", "d", adapter).arguments


def test_a_design_has_one_folder_and_files_in_it_stay(default_layout: Layout, tmp_path: Path) -> None:
    layout = default_layout.replaced(spec=DesignSpec())
    name = write_folder(tmp_path, layout)
    assert name == folder_name(layout) == f"3x3-{layout.identity[:8]}"
    assert read_request(tmp_path / name / "design.toml").spec == DesignSpec()
    (tmp_path / name / "layout.json").write_text("changed by the user")
    assert write_folder(tmp_path, layout) == name
    assert (tmp_path / name / "layout.json").read_text() == "changed by the user"


def test_a_zip_holds_all_files_but_hidden_ones_and_has_the_same_bytes_again(tmp_path: Path) -> None:
    folder = tmp_path / "d" / "parts"
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "a.txt").write_text("a")
    (folder / ".mirrorcam").mkdir()
    (folder / ".mirrorcam" / "written.jsonl").write_text("{}")
    first, second = (zipped(tmp_path, "d/parts") for _ in range(2))
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as archive:
        assert archive.namelist() == ["d/inner/a.txt"]
    first.unlink()
    second.unlink()


@pytest.mark.parametrize("name", ["", "..", "d/..", "../x", "d//parts", "none", "d/parts/inner/a.txt", "d/link"])
def test_no_other_folder_is_zipped(name: str, tmp_path: Path) -> None:
    root = tmp_path / "root"
    (root / "d" / "parts" / "inner").mkdir(parents=True)
    (root / "d" / "parts" / "inner" / "a.txt").touch()
    (root / "d" / "link").symlink_to(tmp_path)
    with pytest.raises(InputError):
        zipped(root, name)
