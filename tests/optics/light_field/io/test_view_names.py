"""Names of views: rows and columns among other numbers, and names of any kind that are no grid."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.view_names import has_named_views, named_views

ROWS, COLS = 3, 4


def names(text: str, first: int = 0) -> list[Path]:
    """Names of all views, with `n` their number in a snake."""
    found = []
    for t in range(ROWS):
        for s in range(COLS):
            number = t * COLS + (s if t % 2 == 0 else COLS - 1 - s)
            found.append(Path(text.format(t=t + first, s=s + first, n=number + 1, y=2 * t - 3.5, x=5.25 - s)))
    return found


@pytest.mark.parametrize(
    ("text", "has_places"),
    [
        ("out_{t:02d}_{s:02d}_{y:.6f}_{x:.6f}_.png", True),
        ("{t}_{s}.png", False),
        ("IMG_0001_{n:03d}_{t:02d}_{s:02d}.png", False),
        ("IMG_2067_5_{t:02d}_{s:02d}.png", False),
        ("view_{t:02d}_{s:02d}_{n:03d}.png", False),
        ("{t:02d}_{n}_{s:02d}.png", False),
        ("r{t}c{s}.png", False),
        ("cam-{t:02d}-{s:02d}_rgb8.png", False),
    ],
)
@pytest.mark.parametrize("first", [0, 1])
def test_row_and_column_are_the_numbers_that_take_all_combinations(text: str, has_places: bool, first: int) -> None:
    expected = names(text, first)
    shuffled = [*expected, Path("cover.png"), Path("map.png")]
    random.Random(3).shuffle(shuffled)
    assert has_named_views(shuffled)
    found = named_views(Path("a"), shuffled)
    assert found.files == tuple(expected)
    assert found.grid == (ROWS, COLS)
    assert (found.places is not None) == has_places
    if found.places is not None:
        assert found.places[2, 1].tolist() == [4.25, 0.5]


@pytest.mark.parametrize("text", ["v_{t}_{s}.png", "{n:02d}_v_{t:+d}_{s:+d}.png", "row_{t}_col_{s}.png"])
def test_rows_and_columns_may_count_from_the_middle(text: str) -> None:
    expected = names(text, first=-1)
    found = named_views(Path("a"), sorted(expected))
    assert found.files == tuple(expected)
    assert found.grid == (ROWS, COLS)


def test_a_grid_of_a_few_of_the_pictures_is_refused() -> None:
    files = [Path(f"v_{t}_{s}.png") for t, s in np.ndindex(2, 2)] + [Path(f"photo {n}.png") for n in range(5)]
    with pytest.raises(InputError, match="only 4 of 9 pictures make a grid"):
        named_views(Path("a"), files)


@pytest.mark.parametrize(
    "text",
    ["frame_{n:04d}.png", "2024-05-01 ({n}).png", "{n}{n}.png", "a{n:0300d}-{t}.png", "x.png", "a_-{t}_-{s}.png"],
)
def test_pictures_of_other_kinds_are_no_views(text: str) -> None:
    files = sorted(set(names(text)))
    assert not has_named_views(files)
    with pytest.raises(InputError, match="has no pictures NAME_ROW_COLUMN_Y_X"):
        named_views(Path("a"), files)


def test_names_of_any_kind_give_a_grid_or_one_line() -> None:
    chosen = random.Random(5)
    parts = [
        "0",
        "1",
        "2",
        "01",
        "9" * 300,
        "-1",
        "1.5",
        "٣",
        "²",
        "a",
        "é",
        "\n",
        " ",
        "_",
        "__",
        "",
        "1e9",
        "999999999",
    ]
    refused = 0
    for _ in range(1000):
        files = [
            Path("_".join(chosen.choices(parts, k=chosen.randint(1, 6))) + ".png") for _ in range(chosen.randint(1, 9))
        ]
        has_named_views(files)
        try:
            found = named_views(Path("a"), files)
        except InputError as error:
            refused += 1
            assert str(error).startswith("a: ")
            continue
        assert len(found.files) == found.grid[0] * found.grid[1]
        assert found.places is None or np.isfinite(found.places).all()
    assert 100 < refused < 1000
