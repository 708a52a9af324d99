"""Light fields as napari's plugin engine, npe2, reads them by the manifest."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import npe2
import numpy as np
import pytest

import mirrorcam.lightfield
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.lightfield.napari_reader import napari_reader
from mirrorcam.optics.light_field.depth.depth_files import save_depth
from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.io.formats import registry
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.light_field import LightField
from tests.lightfield.recordings import noisy_walls, write_recording
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def scene() -> tuple[LightField, FloatArray]:
    light_field, depth, _ = photograph(grid_views(), [Surface(520.0, slope=(0.25, -0.15))])
    return light_field, depth


@pytest.fixture(autouse=True)
def plugin(npe2pm: Any) -> Any:
    """Let npe2 know the manifest of the entry point, and no other."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        entry = tomllib.load(file)["project"]["entry-points"]["napari.manifest"]["mirrorcam"]
    package, _, name = entry.partition(":")
    assert package == mirrorcam.lightfield.__name__
    manifest = npe2.PluginManifest.from_file(Path(mirrorcam.lightfield.__path__[0], name))
    manifest.validate_imports()
    with npe2pm.tmp_plugin(manifest=manifest):
        yield


def read(path: Path) -> list[Any]:
    return list(npe2.read([str(path)], stack=False, plugin_name="mirrorcam"))


def depth_map(light_field: LightField, depth_mm: FloatArray) -> DepthMap:
    view = (light_field.rows // 2, light_field.cols // 2)
    depth = depth_mm.astype(np.float32)
    return DepthMap(
        views=light_field,
        view=view,
        depth_mm=depth,
        sigma_mm=np.ones_like(depth),
        confidence=np.full_like(depth, 0.75),
    )


@pytest.mark.parametrize("to", sorted(set(registry.NAMES) - {"ply", "mcap", "zarr"}))
def test_the_views_of_every_format_are_an_image_stack(
    scene: tuple[LightField, FloatArray], tmp_path: Path, to: str
) -> None:
    path = tmp_path / f"wall{registry.formats()[to].ending}"
    registry.write_light_field(path, scene[0], to)
    ((samples, settings, kind),) = read(path)
    assert kind == "image"
    assert settings["name"] == "wall"
    assert settings["axis_labels"] == ["t", "s", "v", "u"]
    assert settings["rgb"] == (scene[0].samples.shape[-1] == 3)
    assert samples.shape == (scene[0].samples.shape if settings["rgb"] else scene[0].samples.shape[:-1])
    assert np.abs(samples.reshape(scene[0].samples.shape).astype(float) - scene[0].samples).max() <= 1.0


def test_depth_and_confidence_beside_a_light_field_are_layers(
    scene: tuple[LightField, FloatArray], tmp_path: Path
) -> None:
    path, depth = tmp_path / "wall.npz", depth_map(*scene)
    save_npz(path, scene[0])
    save_depth(tmp_path / "wall_depth.npz", depth)
    views, depth_layer, confidence = read(path)
    assert views[1]["name"] == "wall"
    assert np.array_equal(depth_layer[0], depth.depth_mm)
    near, far = depth_layer[1]["contrast_limits"]
    assert depth.depth_mm.min() <= near < far <= depth.depth_mm.max()
    assert np.array_equal(confidence[0], depth.confidence)
    assert confidence[1]["contrast_limits"] == (0.0, 1.0)


def test_the_depth_of_another_light_field_is_refused(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    save_npz(tmp_path / "wall.npz", scene[0])
    save_depth(tmp_path / "wall_depth.npz", depth_map(replace(scene[0], layout_identity="other"), scene[1]))
    with pytest.raises(InputError, match=r"wall_depth\.npz: layout 'other', expected"):
        read(tmp_path / "wall.npz")


def test_a_depth_that_the_file_states_is_a_layer(scene: tuple[LightField, FloatArray], tmp_path: Path) -> None:
    true_mm = depth_map(*scene).depth_mm
    registry.write_light_field(tmp_path / "wall_hci", scene[0], "hci", true_mm)
    _, (depth_mm, settings, _) = read(tmp_path / "wall_hci")
    assert settings["name"] == "wall depth, mm"
    assert np.allclose(depth_mm, true_mm, rtol=1e-4)


def test_frames_of_a_recording_are_read_when_they_are_shown(tmp_path: Path) -> None:
    frames = noisy_walls(3)
    write_recording(tmp_path / "walls.zarr", frames)
    ((stack, settings, _),) = read(tmp_path / "walls.zarr")
    assert settings["axis_labels"] == ["frame", "t", "s", "v", "u"]
    expected = np.stack([frame.samples for frame in frames])
    expected = expected if settings["rgb"] else expected[..., 0]
    assert (stack.shape, stack.ndim, stack.dtype, stack.size) == (
        expected.shape,
        expected.ndim,
        expected.dtype,
        expected.size,
    )
    for key in (1, -1, (2, 0, 1), (0, slice(None), 1), (slice(1, 3), 1, 1, slice(4, 9)), slice(0, 2)):
        assert np.array_equal(stack[key], expected[key])
    with pytest.raises(IndexError):
        stack[3]


def test_what_is_no_light_field_is_left_to_other_readers(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("none")
    assert napari_reader(str(tmp_path / "notes.txt")) is None
    assert napari_reader([str(tmp_path / "missing")]) is None


def test_the_reader_needs_neither_napari_nor_npe2() -> None:
    code = (
        "import sys, mirrorcam.lightfield.napari_reader; print({'napari', 'npe2', 'dask'} & {n for n in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
