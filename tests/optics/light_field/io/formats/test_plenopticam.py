"""Arrays and viewpoints for PlenoptiCam: the parameter that focuses, and viewpoints alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.formats.plenopticam import is_plenopticam, read_plenopticam, write_plenopticam
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from tests.optics.light_field.io.formats.planes import plane


def test_plenopticams_parameter_is_our_disparity(tmp_path: Path) -> None:
    """It pads picture i by a i on the left: pixel u moves to u + a i."""
    light_field = plane(3, 3, 2.0)
    write_plenopticam(tmp_path, light_field)
    array = np.load(tmp_path / "vp_img_arr.npy")
    assert 255 < array.max() <= 65535
    sharp = {}
    for a in (-2, -1, 0, 1, 2):
        slices = []
        for j, i in np.ndindex(3, 3):
            down, across = (
                ((abs(a) * n, abs(a) * (2 - n)) if a >= 0 else (abs(a) * (2 - n), abs(a) * n)) for n in (j, i)
            )
            slices.append(np.pad(array[j, i], (down, across, (0, 0)), "edge")[20:-20, 20:-20])
        sharp[a] = np.mean(slices, axis=0).std()
    assert max(sharp, key=lambda a: sharp[a]) == 2


def test_plenopticams_viewpoints_are_enough(tmp_path: Path) -> None:
    light_field = plane(3, 3, 1.0)
    write_plenopticam(tmp_path, light_field)
    assert sorted(file.name for file in (tmp_path / "viewpoints_3px").iterdir())[3] == "01_00.png"
    for name in ("vp_img_arr.npy", "weights.npy", "views.json"):
        (tmp_path / name).unlink()
    found = read_plenopticam(tmp_path, Assumed(step_mm=10.0, focal_px=400.0, reference_depth_mm=455.0))
    assert np.array_equal(found.samples, light_field.samples)
    (tmp_path / "viewpoints_3px" / "01_00.png").unlink()
    with pytest.raises(InputError, match=r"lacks view \(1, 0\), expected .* of all 3x3"):
        read_plenopticam(tmp_path, Assumed(step_mm=10.0, focal_px=400.0, reference_depth_mm=455.0))


def test_plenopticam_supports_square_grids_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a square grid"):
        write_plenopticam(tmp_path, plane(2, 3, 1.0))


def test_a_file_with_the_name_of_the_folder_of_viewpoints_is_ignored(tmp_path: Path) -> None:
    (tmp_path / "viewpoints_3px").write_bytes(b"a file")
    assert not is_plenopticam(tmp_path)
