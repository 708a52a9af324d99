"""Light fields to work through: each is opened in its turn, under a name of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.console.reporter import TERMINAL
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs, NamedLightField, RecordingFilter
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal import TemporalFilter
from tests.lightfield.recordings import noisy_walls, write_recording
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph
from tests.optics.light_field.io.orders import GIVEN, scene


def test_given_depths_come_before_those_of_the_file() -> None:
    light_field = photograph(grid_views(), [Surface(500.0)])[0]
    scene = NamedLightField("scene", light_field, (300.0, 700.0))
    assert scene.depths_to_search(None, None) == (300.0, 700.0)
    assert scene.depths_to_search(350.0, None) == (350.0, 700.0)
    assert NamedLightField("plain", light_field).depths_to_search(None, 900.0) == (None, 900.0)


def test_each_file_is_opened_and_counted(tmp_path: Path) -> None:
    light_field = photograph(grid_views(), [Surface(500.0)])[0]
    for name in ("a", "b"):
        save_npz(tmp_path / f"{name}.npz", light_field)
    seen: list[tuple[int, int]] = []
    inputs = LightFieldInputs((tmp_path / "b.npz", tmp_path / "a.npz"))
    found = list(inputs.open_all(lambda done, total: seen.append((done, total))))
    assert inputs.count_text == "2 light fields"
    assert [open_all.name for open_all in found] == ["b", "a"]
    assert np.array_equal(found[0].light_field.samples, light_field.samples)
    assert seen == [(1, 2), (2, 2)]


def test_names_that_would_meet_and_frames_without_a_layout_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two light fields are called 'a', expected different names"):
        LightFieldInputs((tmp_path / "a.npz", tmp_path / "other" / "a.npz"))
    write_image(tmp_path / "frame.png", np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(InputError, match="--layout"):
        list(LightFieldInputs((tmp_path / "frame.png",)).open_all())


def test_views_that_differ_are_matched_and_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    light_field = photograph(grid_views(), [Surface(500.0)])[0]
    samples = light_field.samples.copy()
    samples[0, 2] = np.rint(samples[0, 2] * np.array([0.8, 1.0, 0.9])).astype(np.uint8)
    save_npz(tmp_path / "tinted.npz", LightField.of(light_field, samples, light_field.weights))
    save_npz(tmp_path / "alike.npz", light_field)
    paths = tmp_path / "tinted.npz", tmp_path / "alike.npz"
    tinted, alike = LightFieldInputs(paths, reporter=TERMINAL).open_all()
    assert (alike.light_field.samples == light_field.samples).all()
    off = tinted.light_field.samples.astype(float) - light_field.samples
    assert np.abs(off.mean(axis=(2, 3))).max() < 0.02 * light_field.samples.mean()
    said = capsys.readouterr().out
    assert "tinted: views differ by up to 25% in brightness or colour, matched" in " ".join(said.split())
    assert "alike" not in said


def test_views_in_a_different_order_are_reordered_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light_field = scene(2, 3)
    for t, s in np.ndindex(2, 3):
        write_image(tmp_path / "a" / f"{s}_{t}.png", light_field.samples[t, s].astype(np.uint8))
    geometry = "".join(f"{name} = {value}\n" for name, value in GIVEN if value is not None)
    (tmp_path / "a" / "views.toml").write_text(geometry, encoding="utf-8")
    (found,) = LightFieldInputs((tmp_path / "a",), reporter=TERMINAL).open_all()
    assert np.array_equal(found.light_field.samples, light_field.samples)
    assert "a: the pictures show that views are column by column in 3 columns of 2" in capsys.readouterr().out


def test_frames_of_recordings_are_numbered_and_each_recording_is_filtered_on_its_own(tmp_path: Path) -> None:
    frames = noisy_walls(2)
    write_recording(tmp_path / "film.zarr", frames)
    save_npz(tmp_path / "wall.npz", frames[1])
    inputs = LightFieldInputs((tmp_path / "film.zarr", tmp_path / "wall.npz"))
    recording, video = RecordingFilter(), TemporalFilter()
    filtered = [video.filtered(open_all).samples for open_all in frames]
    for _ in range(2):
        first, second, wall = inputs.open_all()
        assert (first.frame, second.frame, wall.frame) == (0, 1, None)
        assert np.array_equal(recording.filtered(first).samples, filtered[0])
        assert np.array_equal(recording.filtered(second).samples, filtered[1])
        assert recording.filtered(wall) is wall.light_field
