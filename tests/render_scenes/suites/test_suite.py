"""Suites: the built-in ones, and files of users.

Costs that are said beforehand: laws here; `tests/bench/test_suite_command.py` compares them with real ones.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites.recipe import SetRecipe
from mirrorcam.render_scenes.suites.suite import (
    START_S,
    SUITES,
    Cost,
    Suite,
    design_seconds,
    elapsed_s,
    read_suite,
    set_cost,
    slowness,
    suite_names,
)


def written(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(text)
    return str(path)


HEAD = 'name = "mine"\nversion = 1\n'


@pytest.mark.parametrize("name", suite_names())
def test_suites_of_the_program_are_valid_and_say_what_each_set_is_for(name: str) -> None:
    suite = read_suite(name)
    assert suite.name == name
    assert suite.description
    assert all(recipe.why for recipe in suite.recipes)


def test_the_standard_suite_covers_what_it_says() -> None:
    sets = read_suite("standard").sets
    counts = {each.design.arrangement.text for each in sets}
    assert {"1 x 2", "2 x 2", "3 x 3", "3 x 5", "4 x 4", "5 x 5", "hex7"} <= counts
    assert len({each.design.camera.name for each in sets}) >= 4
    assert {each.board.kind for each in sets} == {"charuco", "checkerboard", "aprilgrid"}
    assert {each.design.surface for each in sets} == {"first", "second"}
    assert {"rational", "fisheye"} <= {each.camera.lens_model for each in sets}
    assert len({each.sensor for each in sets}) >= 5
    assert len({each.tolerances for each in sets}) >= 4
    assert {each.renderer for each in sets} == {"fast", "mitsuba"}
    assert any(each.base_frames == 0 for each in sets)
    assert any(len(each.depths_mm) == 1 for each in sets)
    assert len({each.seed for each in sets}) == len(sets)


def test_defaults_are_those_of_each_set_that_does_not_state_the_same(tmp_path: Path) -> None:
    suite = read_suite(
        written(
            tmp_path, HEAD + '[defaults]\nframes = 7\nseed = 3\n[[set]]\nname = "a"\n[[set]]\nname = "b"\nframes = 9\n'
        )
    )
    assert [(each.frames, each.seed) for each in suite.sets] == [(7, 3), (9, 3)]


def test_a_layout_is_a_file_beside_the_suite(tmp_path: Path, default_layout: Layout) -> None:
    default_layout.save(tmp_path / "layout.json")
    suite = read_suite(written(tmp_path, HEAD + '[[set]]\nname = "a"\nlayout = "layout.json"\n'))
    assert suite.sets[0].layout == default_layout
    by_default = '[defaults]\nlayout = "layout.json"\n[[set]]\nname = "a"\n'
    assert read_suite(written(tmp_path, HEAD + by_default)).sets == suite.sets
    for hostile in ("../layout.json", "/etc/passwd"):
        with pytest.raises(InputError, match="expected the name of a file in this folder"):
            read_suite(written(tmp_path, HEAD + f'[[set]]\nname = "a"\nlayout = "{hostile}"\n'))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD, "set: Field required"),
        (HEAD + "set = []\n", "set"),
        (HEAD + "set = 3\n", "set"),
        (HEAD + '[[set]]\nname = "a"\n[[set]]\nname = "a"\n', "the name a appears twice"),
        (HEAD + '[[set]]\nname = "a"\ncopies = 2\n[[set]]\nname = "a-0001"\n', "the name a-0001 appears twice"),
        (HEAD + '[[set]]\nname = "a"\nframs = 3\n', "set.0.frams: not known, did you mean frames?"),
        (HEAD + '[[set]]\nname = "a"\nframes = "3"\n', "set.0.frames"),
        (HEAD + '[[set]]\nname = "A/.."\n', "set.0.name"),
        (HEAD + '[[set]]\nname = "a"\ncopies = 100000\n[[set]]\nname = "b"\n', "100001 sets, expected 100000 or fewer"),
        (HEAD + '[defaults]\nname = "x"\n[[set]]\nname = "a"\n', "defaults: expected a table without a name"),
        (HEAD + '[[set]]\nname = "a"\ndesign = { camera = "/etc/passwd" }\n', "expected one of"),
        ("name =", "not valid TOML"),
    ],
)
def test_bad_suites_are_refused_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        read_suite(written(tmp_path, text))
    assert message in str(refused.value)
    assert "mine.toml" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_names_that_are_not_known_are_refused() -> None:
    with pytest.raises(InputError, match=r"expected one of .*smoke.*, or a \.toml file"):
        read_suite("smok")
    with pytest.raises(InputError, match="no such file"):
        read_suite("missing.toml")


def test_the_order_of_sets_and_what_is_stated_as_default_do_not_matter() -> None:
    tables = tomllib.loads((SUITES / "smoke.toml").read_text())
    sets = [tables["defaults"] | each for each in tables.pop("set")]
    tables.pop("defaults")
    turned = Suite.model_validate(tables | {"set": sets[::-1]})
    assert [each.content_inputs() for each in turned.sets[::-1]] == [
        each.content_inputs() for each in read_suite("smoke").sets
    ]


def cost(**stated: object) -> Cost:
    return set_cost(SetRecipe.model_validate({"name": "one"} | stated))


def test_pictures_are_those_of_the_set() -> None:
    assert cost(frames=7, base_frames=3).pictures == 10


@pytest.mark.parametrize(
    "more",
    [
        {"frames": 40},
        {"renderer": "mitsuba"},
        {"maps": True},
        {"sensor": "webcam"},
        {"design": {"camera": "brio"}},
        {"design": {"rows": 5, "cols": 5}},
    ],
)
def test_more_work_takes_longer(more: dict[str, object]) -> None:
    assert cost(**more).seconds > 1.1 * cost().seconds


def test_time_and_size_beyond_those_of_any_set_grow_with_the_pixels() -> None:
    whole, half, quarter = (cost(frames=100, design={"rows": 1, "cols": 2}, binned=b) for b in (1.0, 0.5, 0.25))
    for name in ("seconds", "stored_bytes"):
        steps = [getattr(a, name) - getattr(b, name) for a, b in ((whole, half), (half, quarter))]
        assert steps[0] == pytest.approx(4.0 * steps[1])


def test_size_follows_the_compression() -> None:
    sizes = [cost(sensor=sensor).stored_bytes for sensor in ("poor", "c920", "ideal")]
    assert sizes == sorted(sizes)
    assert cost(maps=True).stored_bytes > 5 * cost().stored_bytes


def test_workers_share_the_work_but_no_set() -> None:
    assert elapsed_s([], 4, 1.0) == 0.0
    assert elapsed_s([10.0] * 8, 1, 1.0) == START_S + 80.0
    assert elapsed_s([10.0] * 8, 4, 1.0) == START_S + 20.0
    assert elapsed_s([10.0] * 8, 100, 1.0) == START_S + 10.0
    assert elapsed_s([30.0, 1.0, 1.0], 2, 1.0) == START_S + 30.0
    assert elapsed_s([10.0] * 8, 4, 2.0) == 2.0 * (START_S + 20.0)


def test_designs_of_more_mirrors_take_longer() -> None:
    assert design_seconds(DesignSpec(rows=5, cols=5)) > design_seconds(DesignSpec(rows=1, cols=2)) > 0.0


def test_the_speed_of_this_machine_is_measured() -> None:
    assert 0.05 < slowness() < 50.0
