"""`mirrorcam filter`, from light fields to light fields that other commands read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cli import main
from mirrorcam.lightfield.filter_command import write_filtered
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
from mirrorcam.lightfield.requests import FilterRequest
from mirrorcam.optics.light_field.filters import Passband, filter_light_field
from mirrorcam.optics.light_field.io.formats.hci import write_hci
from mirrorcam.optics.light_field.io.formats.npz import load_npz, save_npz
from mirrorcam.optics.light_field.light_field import LightField
from tests.command_line import assert_refused_here, results
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

WALL = Surface(480.0, slope=(0.2, -0.3), seed=1)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filter")
    light_field, distance_mm = photograph(grid_views(), [WALL])[:2]
    noise = np.random.default_rng(0).normal(0.0, 20.0, light_field.samples.shape)
    noisy = np.clip(light_field.samples + noise, 0.0, 255.0)
    save_npz(folder / "noisy.npz", LightField.of(light_field, np.rint(noisy).astype(np.uint8), light_field.weights))
    save_npz(folder / "single.npz", photograph(grid_views(1, 1), [WALL])[0])
    write_hci(folder / "scene", light_field, distance_mm.astype(np.float32))
    return folder


def test_filtered_light_fields_are_read_again(inputs: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    asked = ["--near-mm", "330", "--far-mm", "500", "--leave-out", "--out", str(tmp_path)]
    assert main(["filter", str(inputs / "noisy.npz"), *asked]) == 0
    assert results(tmp_path) == ["noisy_filtered.npz", "noisy_filtered_views.png"]
    assert "grey levels outside the hyperfan, 0." in capfd.readouterr().out
    given, filtered = load_npz(inputs / "noisy.npz"), load_npz(tmp_path / "noisy_filtered.npz")
    assert filtered.samples.dtype == np.uint8
    assert np.abs(np.diff(filtered.samples.astype(float), axis=3)).mean() < 0.6 * (
        np.abs(np.diff(given.samples.astype(float), axis=3)).mean()
    )


def test_depths_are_those_that_a_scene_states(inputs: Path, tmp_path: Path) -> None:
    assert main(["filter", str(inputs / "scene"), "--kind", "dual-fan", "--out", str(tmp_path)]) == 0
    assert results(tmp_path) == ["scene_filtered.npz", "scene_filtered_views.png"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("noisy.npz", "a hyperfan passes a range of depths, expected its nearest and farthest depth"),
        ("noisy.npz --near-mm 500 --far-mm 400", "--near-mm 500 --far-mm 400: the nearest depth must be less"),
        ("noisy.npz --kind hypercone --near-mm 300", "--kind hypercone keeps all depths"),
        ("noisy.npz --kind fan", "--kind 'fan': Input should be 'hyperfan'"),
        ("single.npz --kind hypercone", "light field has one view, expected several"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    inputs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: str,
    message: str,
) -> None:
    monkeypatch.chdir(inputs)
    assert_refused_here(["filter", *arguments.split(), "--out", str(tmp_path / "out")], capfd, message)
    assert not (tmp_path / "out" / "noisy_filtered.npz").exists()


def test_what_is_written_is_what_the_filter_gives(tmp_path: Path) -> None:
    light_field = photograph(grid_views(), [Surface(480.0, seed=1)])[0]
    save_npz(tmp_path / "wall.npz", light_field)
    request = FilterRequest(kind="dual-fan", near_mm=370.0, far_mm=450.0)
    found = write_filtered(LightFieldInputs((tmp_path / "wall.npz",)), tmp_path / "out", request)
    expected = filter_light_field(light_field, Passband.of(light_field, "dual-fan", 370.0, 450.0))
    assert results(tmp_path / "out") == ["wall_filtered.npz", "wall_filtered_views.png"]
    assert [(each.name, each.outside, each.left_out) for each in found] == [("wall", expected.outside, 0.0)]
    written = load_npz(tmp_path / "out" / "wall_filtered.npz")
    np.testing.assert_array_equal(written.samples, expected.light_field.samples)
    np.testing.assert_array_equal(written.positions_mm, light_field.positions_mm)
