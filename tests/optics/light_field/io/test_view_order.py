"""Orders of views: the true one passes for any pictures, every other one is corrected or refused."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.view_order import in_order, named_views
from tests.optics.light_field.io.orders import scene, with_samples

GRIDS = [(2, 2), (2, 3), (3, 3), (4, 2)]
ROWS, COLS = 3, 4


def stored(samples: Any, sequence: Any, grid: tuple[int, int] | None = None) -> Any:
    """Return samples (t, s, ...) in a stored order, given the true number of each view, row by row."""
    flat = samples.reshape(-1, *samples.shape[2:])
    return flat[np.asarray(sequence).ravel()].reshape(*(grid or samples.shape[:2]), *samples.shape[2:])


def numbers(samples: Any) -> Any:
    return np.arange(samples.shape[0] * samples.shape[1]).reshape(samples.shape[:2])


def snake(number: Any) -> Any:
    backwards = number.copy()
    backwards[1::2] = backwards[1::2, ::-1]
    return backwards


def noisy(samples: Any) -> Any:
    return np.clip(samples + np.random.default_rng(4).normal(0.0, 15.0, samples.shape), 0, 255).astype(np.uint8)


def faint(samples: Any) -> Any:
    faded = 120 + 0.05 * (samples.astype(float) - 120) + np.random.default_rng(4).normal(0.0, 1.5, samples.shape)
    return faded.astype(np.uint8)


def vignetted(samples: Any) -> Any:
    v, u = np.meshgrid(np.linspace(-1, 1, 90), np.linspace(-1, 1, 120), indexing="ij")
    return (samples * (1.0 - 0.4 * (u**2 + v**2))[..., None]).astype(np.uint8)


def unlike(samples: Any) -> Any:
    gains = np.random.default_rng(4).uniform(0.5, 1.0, (*samples.shape[:2], 1, 1, 1))
    return (samples * gains).astype(np.uint8)


def blurred(samples: Any) -> Any:
    flat = samples.reshape(-1, *samples.shape[2:])
    return np.stack([cv2.GaussianBlur(view, (0, 0), 3.0) for view in flat]).reshape(samples.shape)


def grey(samples: Any) -> Any:
    return (samples[..., :1] / 255.0).astype(np.float32)


@pytest.mark.parametrize("change", [np.array, noisy, faint, vignetted, unlike, blurred, grey])
@pytest.mark.parametrize("grid", [*GRIDS, (1, 2), (1, 4), (2, 1), (4, 1)])
def test_the_true_order_passes(grid: tuple[int, int], change: Callable[[Any], Any]) -> None:
    light_field = with_samples(change(scene(*grid).samples))
    assert in_order(light_field) == (light_field, None)


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("column by column", lambda number: (number.T, number.T.shape)),
        ("column by column", lambda number: (number.T, number.shape)),
        ("in a snake along . rows", lambda number: (snake(number), number.shape)),
        ("in a snake along . columns", lambda number: (snake(number.T), number.shape)),
    ],
    ids=["transposed", "columns", "snake of rows", "snake of columns"],
)
def test_views_in_another_order_are_reordered(grid: tuple[int, int], name: str, order: Any) -> None:
    true = with_samples(scene(*grid).samples)
    found, note = in_order(with_samples(stored(true.samples, *order(numbers(true.samples)))))
    if note is None:
        assert np.array_equal(numbers(true.samples), order(numbers(true.samples))[0])
        return
    assert np.array_equal(found.samples, true.samples)
    assert np.array_equal(found.positions_mm, true.positions_mm)
    import re

    assert re.search(name, note)


@pytest.mark.parametrize(
    ("grid", "sequence", "message"),
    [
        ((3, 3), lambda number: number[::-1], "rows run upwards, or columns leftwards"),
        ((3, 3), lambda number: number[:, ::-1], "rows run upwards, or columns leftwards"),
        ((2, 2), lambda number: number[::-1], "rows run upwards, or columns leftwards"),
        ((3, 3), lambda number: number.T[::-1], "column by column in 3 columns of 3, and rows run upwards"),
        (
            (3, 3),
            lambda _: [4, 8, 3, 1, 6, 0, 7, 2, 5],
            "9 of 9 views at different positions|8 of 9 views at different positions",
        ),
        ((3, 3), lambda _: [8, 1, 2, 3, 4, 5, 6, 7, 0], "2 of 9 views at different positions"),
    ],
    ids=["rows upwards", "columns leftwards", "two by two", "both", "shuffled", "two exchanged"],
)
def test_uncertain_orders_are_refused(grid: tuple[int, int], sequence: Any, message: str) -> None:
    samples = scene(*grid).samples
    with pytest.raises(InputError, match=message):
        in_order(with_samples(stored(samples, sequence(numbers(samples)))))


@pytest.mark.parametrize(("true", "given"), [((3, 3), (1, 9)), ((2, 4), (1, 8)), ((4, 2), (1, 8))])
def test_another_number_of_rows_is_refused(true: tuple[int, int], given: tuple[int, int]) -> None:
    samples = scene(*true).samples
    with pytest.raises(InputError, match=f"row by row in {true[0]} rows of {true[1]}"):
        in_order(with_samples(stored(samples, numbers(samples), given)))


def moved(rows: int, cols: int, picture: Any, step_px: tuple[float, float]) -> Any:
    """Return samples of views in which a picture moves by a step from view to view."""
    height, width = picture.shape
    flat = [
        cv2.warpAffine(picture, np.array([[1.0, 0.0, -s * step_px[0]], [0.0, 1.0, -t * step_px[1]]]), (width, height))
        for t, s in np.ndindex(rows, cols)
    ]
    return np.stack(flat)[:, 30:-30, 30:-30, None].repeat(3, axis=-1).reshape(rows, cols, height - 60, width - 60, 3)


def test_rows_of_many_views_with_small_steps_are_not_taken_for_a_single_row() -> None:
    rng = np.random.default_rng(2)
    texture = cv2.GaussianBlur(rng.normal(0.0, 1.0, (260, 260)), (0, 0), 2.0)
    views = 120.0 + 20.0 * moved(7, 7, texture / texture.std(), (0.35, 0.35))
    noisy_views = (views + rng.normal(0.0, 3.0, views.shape)).clip(0, 255).astype(np.uint8)
    with pytest.raises(InputError, match="row by row in 7 rows of 7"):
        in_order(with_samples(noisy_views.reshape(1, 49, *views.shape[2:])))


def test_a_repeating_texture_does_not_determine_the_direction() -> None:
    row, col = np.indices((200, 220)) // 16
    board = np.where((row + col) % 2, 230, 20).astype(np.uint8)
    light_field = with_samples(moved(3, 3, board, (4.0, 21.0)))
    found, note = in_order(light_field)
    assert found is light_field
    assert note is not None
    assert "repeating" in note


def test_a_column_stated_as_a_row_becomes_a_column() -> None:
    true = with_samples(scene(4, 1).samples)
    found, note = in_order(with_samples(true.samples.swapaxes(0, 1)))
    assert note == "the pictures show that views are in one column: reordered"
    assert np.array_equal(found.samples, true.samples)
    assert np.array_equal(found.positions_mm, true.positions_mm)


def test_reversed_rows_and_columns_look_like_a_scene_behind_zero_disparity() -> None:
    light_field = with_samples(scene(3, 3).samples[::-1, ::-1])
    assert in_order(light_field) == (light_field, None)


def test_positions_with_x_and_y_exchanged_are_refused() -> None:
    true = scene(2, 3)
    uneven = true.positions_mm + np.random.default_rng(3).uniform(-1, 1, true.positions_mm.shape) * [1.0, 1.0, 0.0]
    uneven -= uneven[1, 1]
    assert in_order(replace(true, positions_mm=uneven))[1] is None
    with pytest.raises(InputError, match="with x and y exchanged"):
        in_order(replace(true, positions_mm=uneven[..., [1, 0, 2]]))


def test_a_fixed_order_is_not_changed() -> None:
    with pytest.raises(InputError, match="column by column in 3 columns of 3, expected row by row"):
        in_order(with_samples(scene(3, 3).samples.swapaxes(0, 1)), may_change=False)


def names(text: str, first: int = 0) -> list[Path]:
    """Return names of all views, with `n` their number in boustrophedon order."""
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
def test_row_and_column_are_the_numbers_with_all_combinations(text: str, has_places: bool, first: int) -> None:
    expected = names(text, first)
    shuffled = [*expected, Path("cover.png"), Path("map.png")]
    random.Random(3).shuffle(shuffled)
    found = named_views(Path("a"), shuffled)
    assert found.files == tuple(expected)
    assert found.grid == (ROWS, COLS)
    assert (found.positions is not None) == has_places
    if found.positions is not None:
        assert found.positions[2, 1].tolist() == [4.25, 0.5]


@pytest.mark.parametrize("text", ["v_{t}_{s}.png", "{n:02d}_v_{t:+d}_{s:+d}.png", "row_{t}_col_{s}.png"])
def test_rows_and_columns_may_count_from_the_middle(text: str) -> None:
    expected = names(text, first=-1)
    found = named_views(Path("a"), sorted(expected))
    assert found.files == tuple(expected)
    assert found.grid == (ROWS, COLS)


@pytest.mark.parametrize(
    ("text", "count", "grid", "expected"),
    [
        ("view{}.png", 12, (1, 12), (1, 12)),
        ("view{}.png", 12, (1, None), (1, 12)),
        ("view{}.png", 12, (None, 4), (3, 4)),
        ("IMG_{:04d}.JPG", 9, (3, 3), (3, 3)),
        ("2024-05-01 ({}).png", 12, (3, 4), (3, 4)),
    ],
)
def test_given_rows_or_columns_take_names_in_natural_order(
    text: str, count: int, grid: tuple[int | None, int | None], expected: tuple[int, int]
) -> None:
    views = [Path(text.format(n)) for n in range(count)]
    mixed = [*views, Path("left.png"), Path("right 3.png")]
    random.Random(2).shuffle(mixed)
    found = named_views(Path("a"), mixed, grid)
    assert found.files == tuple(views)
    assert found.grid == expected
    assert named_views(Path("a"), sorted(views), grid).files == tuple(views)


def test_names_of_a_grid_take_precedence_over_natural_order_if_they_fit() -> None:
    columns_first = sorted(Path(f"{s}_{t}.png") for t, s in np.ndindex(2, 3))
    assert named_views(Path("a"), columns_first, (3, 2)).files == tuple(columns_first)
    assert named_views(Path("a"), columns_first, (2, 3)).files == tuple(columns_first)
    with pytest.raises(InputError, match="a: 6 pictures, of which none or several kinds form 2 rows and 2 columns"):
        named_views(Path("a"), columns_first, (2, 2))


@pytest.mark.parametrize("text", ["Original Camera_{t:02d}_{s:02d}_{y:.6f}_{x:.6f}_30_36.jpg", "out_{t}_{s}.png"])
def test_blocks_of_a_larger_grid_may_skip_views(text: str) -> None:
    """Rows 11, 13, 15 and columns 30, 32: from the bottom right, as in a set that Blender exported."""
    files = [
        Path(text.format(t=t, s=s, y=400.0 - 10.0 * t, x=400.0 - 10.0 * s)) for t in (11, 13, 15) for s in (30, 32)
    ]
    found = named_views(Path("a"), files)
    assert found.grid == (3, 2)
    if found.positions is None:
        assert found.files == tuple(files)
    else:
        assert found.files == tuple(files[::-1])
        assert found.focal_widths == 30 / 36
        assert found.positions[:, 0].tolist() == [[80.0, 250.0], [80.0, 270.0], [80.0, 290.0]]
    uneven = [Path(f"out_{t}_{s}.png") for t in (11, 12, 15) for s in (30, 32)]
    with pytest.raises(InputError, match="rows 11, 12, 15 are not evenly spaced"):
        named_views(Path("a"), uneven)


def test_a_grid_of_few_of_the_pictures_is_refused() -> None:
    files = [Path(f"v_{t}_{s}.png") for t, s in np.ndindex(2, 2)] + [Path(f"photo {n}.png") for n in range(5)]
    with pytest.raises(InputError, match="only 4 of 9 pictures form a grid"):
        named_views(Path("a"), files)


@pytest.mark.parametrize(
    "text",
    ["frame_{n:04d}.png", "2024-05-01 ({n}).png", "{n}{n}.png", "a{n:0300d}-{t}.png", "x.png", "a_-{t}_-{s}.png"],
)
def test_pictures_of_other_types_are_not_views(text: str) -> None:
    files = sorted(set(names(text)))
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
        grid = chosen.choice([(None, None), (None, None), (1, None), (None, 2), (2, 3)])
        try:
            found = named_views(Path("a"), files, grid)
        except InputError as error:
            refused += 1
            assert str(error).startswith("a: ")
            continue
        assert len(found.files) == found.grid[0] * found.grid[1]
        assert found.positions is None or np.isfinite(found.positions).all()
    assert 100 < refused < 1000
