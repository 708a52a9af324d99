"""Pictures of all views: transparent pixels, and pictures that do not divide into views."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.io.mosaic import AXES, Order, check_division, read_mosaic, write_mosaic
from mirrorcam.optics.light_field.io.view_images import write_rgba
from tests.optics.light_field.io.formats.planes import plane
from tests.optics.light_field.io.orders import GIVEN, scene
from tests.optics.light_field.io.test_view_order import blurred, faint, noisy, unlike, vignetted

GRIDS = [(1, 2), (2, 2), (2, 3), (4, 4)]


def test_colours_of_pixels_without_weight_are_dropped(tmp_path: Path) -> None:
    """Painting programs store arbitrary colours in transparent pixels."""
    light_field = plane(2, 3, 0.8)
    write_mosaic(tmp_path / "a.png", light_field, "tiles")
    opacity = np.full((180, 360), 255, np.uint8)
    opacity[:90, :120] = 0
    write_rgba(tmp_path / "a.png", read_image(tmp_path / "a.png"), opacity)
    found = read_mosaic(tmp_path / "a.png", "tiles")
    assert not found.samples[0, 0].any()
    assert not found.weights[0, 0].any()
    assert np.array_equal(found.samples[1], light_field.samples[1])


def test_mosaics_must_divide_into_views(tmp_path: Path) -> None:
    write_mosaic(tmp_path / "a.png", plane(2, 3, 0.0), "tiles")
    (tmp_path / "a.json").unlink()
    with pytest.raises(InputError, match="do not divide into 7x2 views"):
        read_mosaic(
            tmp_path / "a.png", "tiles", Assumed(rows=2, cols=7, step_mm=1.0, focal_px=1.0, reference_depth_mm=9.0)
        )


def test_a_file_next_to_the_picture_takes_precedence_over_its_pixels(tmp_path: Path) -> None:
    """Only an unstated division is tested."""
    write_mosaic(tmp_path / "a.png", scene(2, 3), "eslf")
    assert np.array_equal(read_mosaic(tmp_path / "a.png", "tiles").samples, scene(2, 3).samples)
    (tmp_path / "a.json").unlink()
    given = GIVEN.replaced(rows=2, cols=3)
    with pytest.raises(InputError, match=r"^tiles of 2 rows and 3 columns .* shows lenslets of 3x2 px"):
        read_mosaic(tmp_path / "a.png", "tiles", given)
    assert np.array_equal(read_mosaic(tmp_path / "a.png", "eslf", given).samples, scene(2, 3).samples)


def mosaic(samples: Any, order: Order) -> Any:
    """Return the picture of samples (t, s, v, u, c) in an order."""
    rows, cols, height, width = samples.shape[:4]
    return samples.transpose(*AXES[order], 4).reshape(rows * height, cols * width, -1)


def flat(samples: Any) -> Any:
    return np.full_like(samples, 90)


def only_noise(samples: Any) -> Any:
    return np.random.default_rng(6).integers(60, 180, samples.shape).astype(np.uint8)


@pytest.mark.parametrize("change", [np.array, noisy, faint, vignetted, unlike, blurred, flat, only_noise])
@pytest.mark.parametrize("order", ["eslf", "tiles"])
@pytest.mark.parametrize("grid", GRIDS)
def test_the_true_division_passes(grid: tuple[int, int], order: Order, change: Callable[[Any], Any]) -> None:
    check_division(mosaic(change(scene(*grid).samples), order), grid, order)


@pytest.mark.parametrize("grid", [(2, 2), (2, 3), (4, 4)])
def test_lenslets_and_tiles_are_distinguished(grid: tuple[int, int]) -> None:
    samples = scene(*grid).samples
    with pytest.raises(InputError, match=rf"shows lenslets of {grid[1]}x{grid[0]} px, expected a name with _eslf"):
        check_division(mosaic(samples, "eslf"), grid, "tiles")
    with pytest.raises(InputError, match="shows adjacent views, not lenslets"):
        check_division(mosaic(samples, "tiles"), grid, "eslf")


@pytest.mark.parametrize(
    "given", [(2, 8), (8, 2), (1, 16), (8, 8), (3, 4), (4, 3), (2, 2), (2, 4), (4, 2), (1, 4), (4, 1)]
)
def test_tiles_of_other_numbers_are_refused(given: tuple[int, int]) -> None:
    picture = mosaic(scene(4, 4).samples, "tiles")
    with pytest.raises(InputError, match="the picture looks like rows = 4, cols = 4"):
        check_division(picture, given, "tiles")


def board(size_px: int) -> Any:
    """Return views (3, 3, 90, 120, 3) of a scene with a checkerboard in the plane of zero disparity."""
    views = scene(3, 3).samples.copy()
    row, col = np.indices((60, 80)) // size_px
    views[:, :, 15:75, 20:100] = np.where((row + col) % 2, 220, 20)[..., None]
    return views


@pytest.mark.parametrize("order", ["eslf", "tiles"])
@pytest.mark.parametrize("size_px", [4, 6, 8, 12, 16])
def test_textures_that_repeat_are_not_refused(size_px: int, order: Order) -> None:
    check_division(mosaic(board(size_px), order), (3, 3), order)


@pytest.mark.parametrize("cols", [3, 5, 9])
def test_lenslets_of_views_of_unequal_brightness_pass(cols: int) -> None:
    samples = scene(1, cols).samples
    for seed in range(6):
        gains = np.random.default_rng(seed).uniform(0.7, 1.0, (1, cols, 1, 1, 1))
        check_division(mosaic((samples * gains).astype(np.uint8), "eslf"), (1, cols), "eslf")


def test_tiles_cut_where_the_scene_has_an_edge_are_refused() -> None:
    samples = scene(3, 3).samples.copy()
    samples[:, :, : samples.shape[2] // 2] = 0.9 * samples[:, :, : samples.shape[2] // 2]
    with pytest.raises(InputError, match="the picture looks like rows = 3, cols = 3"):
        check_division(mosaic(samples, "tiles"), (2, 3), "tiles")


@pytest.mark.parametrize(
    ("given", "message"), [((2, 4), "rows = 2: it looks like rows = 4"), ((4, 8), "cols = 8: it looks like cols = 4")]
)
def test_lenslets_of_another_size_are_refused(given: tuple[int, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_division(mosaic(scene(4, 4).samples, "eslf"), given, "eslf")


def test_a_photograph_has_no_tiles() -> None:
    with pytest.raises(InputError, match="not views of one scene, give rows and cols"):
        check_division(blurred(scene(1, 1).samples)[0, 0], (2, 2), "tiles")
