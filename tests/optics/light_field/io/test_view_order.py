"""Orders of views: the true one passes whatever the pictures are like, every other one is undone or refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.view_order import in_order
from tests.optics.light_field.io.orders import scene, with_samples

GRIDS = [(2, 2), (2, 3), (3, 3), (4, 2)]


def stored(samples: Any, sequence: Any, grid: tuple[int, int] | None = None) -> Any:
    """Samples (t, s, ...) whose view number n, row by row in a grid, is that of a number in the true order."""
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
def test_views_in_another_order_are_put_right(grid: tuple[int, int], name: str, order: Any) -> None:
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
        ((3, 3), lambda _: [4, 8, 3, 1, 6, 0, 7, 2, 5], "9 of 9 views at other places|8 of 9 views at other places"),
        ((3, 3), lambda _: [8, 1, 2, 3, 4, 5, 6, 7, 0], "2 of 9 views at other places"),
    ],
    ids=["rows upwards", "columns leftwards", "two by two", "both", "shuffled", "two exchanged"],
)
def test_orders_that_are_not_certain_are_refused(grid: tuple[int, int], sequence: Any, message: str) -> None:
    samples = scene(*grid).samples
    with pytest.raises(InputError, match=message):
        in_order(with_samples(stored(samples, sequence(numbers(samples)))))


@pytest.mark.parametrize(("true", "given"), [((3, 3), (1, 9)), ((2, 4), (1, 8)), ((4, 2), (1, 8))])
def test_another_number_of_rows_is_refused(true: tuple[int, int], given: tuple[int, int]) -> None:
    samples = scene(*true).samples
    with pytest.raises(InputError, match=f"row by row in {true[0]} rows of {true[1]}"):
        in_order(with_samples(stored(samples, numbers(samples), given)))


def moved(rows: int, cols: int, picture: Any, step_px: tuple[float, float]) -> Any:
    """Samples of views, each of which shows a picture moved by a step further than its neighbours."""
    height, width = picture.shape
    flat = [
        cv2.warpAffine(picture, np.array([[1.0, 0.0, -s * step_px[0]], [0.0, 1.0, -t * step_px[1]]]), (width, height))
        for t, s in np.ndindex(rows, cols)
    ]
    return np.stack(flat)[:, 30:-30, 30:-30, None].repeat(3, axis=-1).reshape(rows, cols, height - 60, width - 60, 3)


def test_rows_of_many_views_with_small_steps_are_told_from_a_single_row() -> None:
    rng = np.random.default_rng(2)
    texture = cv2.GaussianBlur(rng.normal(0.0, 1.0, (260, 260)), (0, 0), 2.0)
    views = 120.0 + 20.0 * moved(7, 7, texture / texture.std(), (0.35, 0.35))
    noisy_views = (views + rng.normal(0.0, 3.0, views.shape)).clip(0, 255).astype(np.uint8)
    with pytest.raises(InputError, match="row by row in 7 rows of 7"):
        in_order(with_samples(noisy_views.reshape(1, 49, *views.shape[2:])))


def test_a_texture_that_repeats_does_not_tell_the_direction() -> None:
    row, col = np.indices((200, 220)) // 16
    board = np.where((row + col) % 2, 230, 20).astype(np.uint8)
    light_field = with_samples(moved(3, 3, board, (4.0, 21.0)))
    found, note = in_order(light_field)
    assert found is light_field
    assert note is not None
    assert "repeats" in note


def test_a_column_that_is_given_as_a_row_becomes_a_column() -> None:
    true = with_samples(scene(4, 1).samples)
    found, note = in_order(with_samples(true.samples.swapaxes(0, 1)))
    assert note == "the pictures show that views are in one column: read so"
    assert np.array_equal(found.samples, true.samples)
    assert np.array_equal(found.positions_mm, true.positions_mm)


def test_reversed_rows_and_columns_are_a_scene_behind_the_plane_of_zero_disparity() -> None:
    light_field = with_samples(scene(3, 3).samples[::-1, ::-1])
    assert in_order(light_field) == (light_field, None)


def test_places_with_x_and_y_exchanged_are_refused() -> None:
    true = scene(2, 3)
    uneven = true.positions_mm + np.random.default_rng(3).uniform(-1, 1, true.positions_mm.shape) * [1.0, 1.0, 0.0]
    uneven -= uneven[1, 1]
    assert in_order(replace(true, positions_mm=uneven))[1] is None
    with pytest.raises(InputError, match="with x and y exchanged"):
        in_order(replace(true, positions_mm=uneven[..., [1, 0, 2]]))


def test_nothing_is_changed_where_only_the_given_order_may_be_taken() -> None:
    with pytest.raises(InputError, match="column by column in 3 columns of 3, expected row by row"):
        in_order(with_samples(scene(3, 3).samples.swapaxes(0, 1)), may_change=False)
