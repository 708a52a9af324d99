"""One set of a suite in a worker: the name of its folder, its files, and its errors."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam.core.disk.program import modules_of, program_of
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites import set_work
from mirrorcam.render_scenes.suites.recipe import SetRecipe
from mirrorcam.render_scenes.suites.set_work import CODE, SetTask, folder_name, render_in_turn, render_on_one_core
from mirrorcam.render_scenes.variant import choose_variant

pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
BOARD = {"kind": "charuco", "cols": 8, "rows": 6, "square_mm": 30.0, "marker_mm": 22.5}


def task(layout: Layout, folder: Path | None = None, **stated: object) -> str:
    small = {"name": "small", "layout": layout, "binned": 0.125, "board": BOARD, "frames": 3, "base_frames": 0}
    recipe = SetRecipe.model_validate(small | stated)
    return SetTask(recipe=recipe, variant=choose_variant(), folder=folder).model_dump_json()


def test_names_follow_from_request_sources_and_variant(monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = SetRecipe(name="one")
    name = folder_name(recipe, "llvm_ad_mono")
    assert name == folder_name(recipe, "llvm_ad_mono")
    assert name.startswith("one-")
    assert len(name) == len("one-") + 16
    others = {folder_name(recipe.replaced(seed=1), "llvm_ad_mono"), folder_name(recipe, "cuda_ad_mono")}
    monkeypatch.setattr(set_work, "program_of", lambda *modules: {"numpy": "1.0"})
    others.add(folder_name(recipe, "llvm_ad_mono"))
    assert len(others | {name}) == 4


def test_sets_depend_on_what_renders_and_designs_them_alone() -> None:
    found = modules_of(*CODE)
    assert {"mirrorcam.optics.design.optimise", "mirrorcam.render_scenes.fast.analytic_scene"} <= found
    others = ("optics.calibration", "optics.light_field", "render_scenes.tabletop", "render_scenes.suites.suite")
    assert not [name for name in found if name.startswith(tuple(f"mirrorcam.{other}" for other in others))]
    assert {"mitsuba", "drjit", "opencv-contrib-python-headless", "casadi"} <= program_of(*CODE).keys()


def test_files_are_the_same_in_a_folder_and_as_an_answer(default_layout: Layout, tmp_path: Path) -> None:
    written = render_on_one_core(task(default_layout, tmp_path / "set"))
    sent = render_in_turn(task(default_layout))
    assert (written.failure, sent.failure) == ("", "")
    assert dict(written.files) == {}
    files = {p.relative_to(tmp_path / "set").as_posix(): p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    assert dict(sent.files) == files
    assert "dataset.json" in files
    assert written.made_with == program_of(*CODE)
    assert written.seconds > 0.0


def test_errors_are_failures_in_one_line(default_layout: Layout, monkeypatch: pytest.MonkeyPatch) -> None:
    refused = render_on_one_core(task(default_layout, board=BOARD | {"square_mm": 1.0, "marker_mm": 0.7}))
    assert "too small to be resolved" in refused.failure

    def broken(recipe: SetRecipe, designed: Layout | None) -> None:
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr(SetRecipe, "request", broken)
    assert render_on_one_core(task(default_layout)).failure == "ZeroDivisionError: two lines"
