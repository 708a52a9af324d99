"""Suites: those of the program, and files of users."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites.suite import SUITES, Suite, read_suite, suite_names


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
    assert [each.stated() for each in turned.sets[::-1]] == [each.stated() for each in read_suite("smoke").sets]
