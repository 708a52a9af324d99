"""Files for the Light Field Toolbox: its slope, its intrinsic matrix, and its weight channel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import loadmat, savemat

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.formats.lftoolbox import read_lftoolbox, write_lftoolbox
from tests.optics.light_field.io.formats.planes import (
    DISTANCE_MM,
    FOCAL_PX,
    STEP_MM,
    plane,
    shift_that_agrees,
    with_gaps,
)

DISPARITY_PX = 1.6


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """Return a plane nearer than the reference plane, on disk and in memory."""
    path = tmp_path_factory.mktemp("lftoolbox") / "a.mat"
    light_field = plane(3, 3, DISPARITY_PX)
    write_lftoolbox(path, light_field)
    return path, light_field


def test_its_slope_focuses_the_plane(written: tuple[Path, Any]) -> None:
    """LFFiltShiftSum reads views at u + linspace(-0.5, 0.5, N) N slope: N / (N - 1) slopes from view to view."""
    lf = loadmat(written[0])["LF"]
    assert lf.shape == (3, 3, 90, 120, 4)
    steps = np.linspace(-0.5, 0.5, 3) * 3
    slope = shift_that_agrees(lf[..., :3], lambda k, t, s: (k * steps[s], k * steps[t]), np.linspace(-2, 2, 41))
    assert slope == pytest.approx(-DISPARITY_PX * (3 - 1) / 3, abs=0.02)


def test_rays_of_h_meet_at_the_plane(written: tuple[Path, Any]) -> None:
    """Pixels of a point of the plane in two views give rays [s, t, u, v] = H [i, j, k, l, 1] with D = 1 m."""
    h = loadmat(written[0])["RectOptions"]["RectCamIntrinsicsH"].item()
    expected_m = 1.0 / (1.0 / DISTANCE_MM + DISPARITY_PX / (FOCAL_PX * STEP_MM)) / 1000.0
    # In MATLAB's indices, from the middle view to its lower right neighbour.
    one = h @ [2, 2, 60.0, 40.0, 1]
    other = h @ [3, 3, 60.0 - DISPARITY_PX, 40.0 - DISPARITY_PX, 1]
    distance_m = (other[:2] - one[:2]) / (one[2:4] - other[2:4])
    assert np.allclose(distance_m, expected_m, rtol=1e-9)
    point_m = [*one[:2] + expected_m * one[2:4], expected_m]
    pixels = written[1].project_in_view(np.array(point_m) * 1000.0)
    assert np.allclose(pixels[1, 1], [59.0, 39.0], atol=1e-9)


def test_a_name_without_the_ending_is_kept(written: tuple[Path, Any], tmp_path: Path) -> None:
    write_lftoolbox(tmp_path / "a", written[1])
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert np.array_equal(read_lftoolbox(tmp_path / "a").samples, written[1].samples)


def test_an_even_grid_is_read_from_h_alone(written: tuple[Path, Any], tmp_path: Path) -> None:
    path, light_field = written
    said = loadmat(path)
    savemat(tmp_path / "theirs.mat", {"LF": said["LF"], "RectOptions": said["RectOptions"]})
    found = read_lftoolbox(tmp_path / "theirs.mat")
    assert np.array_equal(found.samples, light_field.samples)
    assert np.allclose(found.positions_mm, light_field.positions_mm, atol=1e-9)
    assert np.allclose(found.matrices, light_field.matrices, rtol=1e-12)
    assert found.reference_distance_mm == pytest.approx(DISTANCE_MM)


def test_the_views_of_a_lenslet_camera_are_where_their_rays_meet(written: tuple[Path, Any], tmp_path: Path) -> None:
    """Lytro's H gives s and t on a plane other than that of the views: here 25 mm away."""
    said = loadmat(written[0])
    h = said["RectOptions"]["RectCamIntrinsicsH"].item()
    h[:2] += 0.025 * h[2:4]
    savemat(tmp_path / "lytro.mat", {"LF": said["LF"], "RectOptions": {"RectCamIntrinsicsH": h}})
    found = read_lftoolbox(tmp_path / "lytro.mat")
    assert np.allclose(found.positions_mm, written[1].positions_mm, atol=1e-9)
    assert np.allclose(found.matrices, written[1].matrices, rtol=1e-9)


def test_uneven_grids_get_the_h_of_the_nearest_even_one(tmp_path: Path) -> None:
    light_field = plane(3, 3, 1.0, uneven=True)
    write_lftoolbox(tmp_path / "a.mat", light_field)
    h = loadmat(tmp_path / "a.mat")["RectOptions"]["RectCamIntrinsicsH"].item()
    even = light_field.on_regular_grid()
    for t, s in np.ndindex(3, 3):
        assert np.allclose((h @ [s + 1, t + 1, 0, 0, 1])[:2] * 1000.0, even.positions_mm[t, s, :2], atol=1e-9)
    assert np.abs(even.positions_mm - light_field.positions_mm).max() > 0.5


@pytest.mark.parametrize(("kind", "largest"), [(np.uint8, 255), (np.uint16, 65535), (np.float32, 1), (np.float64, 1)])
def test_weights_are_the_last_channel_in_every_type(tmp_path: Path, kind: Any, largest: int) -> None:
    light_field = with_gaps(plane(2, 2, 1.0))
    h = np.diag([0.01, 0.01, 1 / 400, 1 / 400, 1.0])
    h[2, 0] = h[3, 1] = -0.01 / 0.5
    values = np.concatenate([light_field.samples / 255.0, light_field.weights[..., None]], axis=-1) * largest
    lf = (np.rint(values) if largest > 1 else values).astype(kind)
    savemat(tmp_path / "a.mat", {"LF": lf, "RectOptions": {"RectCamIntrinsicsH": h}})
    found = read_lftoolbox(tmp_path / "a.mat")
    assert np.array_equal(found.valid, light_field.valid)
    scale = 1 if found.samples.dtype == np.uint8 else 255
    assert np.abs(found.samples.astype(float) * scale - light_field.samples).max() < 0.01


def test_files_of_matlab_7_3_are_read_as_the_toolbox_saves_them(written: tuple[Path, Any], tmp_path: Path) -> None:
    """HDF5 after 512 bytes of MATLAB's header, columns first."""
    said, path = loadmat(written[0]), tmp_path / "IMG__Decoded.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["LF"] = (said["LF"].astype(np.uint16) * 257).T
        file["RectOptions/RectCamIntrinsicsH"] = said["RectOptions"]["RectCamIntrinsicsH"].item().T
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128))
    found = read_lftoolbox(path)
    assert found.samples.dtype == np.float32
    assert np.abs(found.samples * 255.0 - written[1].samples).max() < 1e-3
    assert np.allclose(found.positions_mm, written[1].positions_mm, atol=1e-9)
    assert np.allclose(found.matrices, written[1].matrices, rtol=1e-9)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"not a \.mat file"):
        read_lftoolbox(path)


def test_files_of_other_programs_are_refused(written: tuple[Path, Any], tmp_path: Path) -> None:
    lf, h = loadmat(written[0])["LF"], np.diag([0.01, 0.01, 1 / 400, 1 / 400, 1.0])
    tall = np.diag([0.01, 0.01, 1 / 400, 1 / 300, 1.0])
    h[2, 0] = h[3, 1] = 0.01  # the rays of neighbouring views meet behind them
    path = tmp_path / "a.mat"
    for said, message in (
        ({"other": 1}, "no array LF"),
        ({"LF": np.zeros((3, 3))}, "no array LF"),
        ({"LF": lf}, "does not state its step_mm"),
        ({"LF": lf.astype(np.int32), "RectOptions": {"RectCamIntrinsicsH": h}}, "int32, expected"),
        ({"LF": np.concatenate([lf, lf], axis=-1)}, "8 channels"),
        ({"LF": lf, "RectOptions": {"RectCamIntrinsicsH": h}}, "no common plane"),
        ({"LF": lf, "RectOptions": {"RectCamIntrinsicsH": tall}}, "square pixels"),
        ({"LF": lf, "MirrorCam": {"focal_px": 1.0}}, "does not describe views"),
        (
            {"LF": lf.astype(np.float32) * np.nan, "MirrorCam": loadmat(written[0])["MirrorCam"]},
            "weights must lie within",
        ),
    ):
        savemat(path, said)
        with pytest.raises(InputError, match=message):
            read_lftoolbox(path)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(200))
    with pytest.raises(InputError, match=r"not a \.mat file"):
        read_lftoolbox(path)
    path.write_bytes(written[0].read_bytes()[:5000])
    with pytest.raises(InputError, match=r"not a \.mat file"):
        read_lftoolbox(path)
