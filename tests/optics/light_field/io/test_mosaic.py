"""Pictures of all views: what is transparent, and what does not divide into views."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.io.mosaic import read_mosaic, write_mosaic
from mirrorcam.optics.light_field.io.view_images import write_rgba
from tests.optics.light_field.io.formats.planes import plane
from tests.optics.light_field.io.orders import GIVEN, scene


def test_colours_of_pixels_without_weight_are_dropped(tmp_path: Path) -> None:
    """Painting programs leave any colour where a picture is transparent."""
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


def test_a_file_beside_the_picture_goes_before_its_pixels(tmp_path: Path) -> None:
    """Only a division that nobody states is tested."""
    write_mosaic(tmp_path / "a.png", scene(2, 3), "eslf")
    assert np.array_equal(read_mosaic(tmp_path / "a.png", "tiles").samples, scene(2, 3).samples)
    (tmp_path / "a.json").unlink()
    given = GIVEN.replaced(rows=2, cols=3)
    with pytest.raises(InputError, match=r"^tiles of 2 rows and 3 columns .* shows lenslets of 3x2 px"):
        read_mosaic(tmp_path / "a.png", "tiles", given)
    assert np.array_equal(read_mosaic(tmp_path / "a.png", "eslf", given).samples, scene(2, 3).samples)
