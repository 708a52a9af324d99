"""Unequal mirrors: known factors on the sub-images of an analytic scene are found and corrected."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.equalisation import Equalisation, VignettedLevels, fit_exponent, measure
from mirrorcam.optics.light_field.light_field import LightField, Views
from tests.optics.light_field.photographs import Texture, photographed, reflected_rays, waves

RANDOM = np.random.default_rng(8)
GAIN = np.exp(RANDOM.uniform(-0.35, 0.1, (2, 3, 3)))
GAIN[1, 1] = 1.0


def plain(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.full_like(x, 0.7)


def unequal(layout: Layout, depth_mm: float, texture: Texture, gain: FloatArray) -> LightField:
    """Decode 8-bit frames whose sub-images are scaled in brightness by factors (t, s, c)."""
    frame = photographed(layout, depth_mm, texture)
    for (hit, _, _), factor in zip(reflected_rays(layout), gain.reshape(-1, 3), strict=True):
        frame[hit] *= factor
    return Decoder(layout).decode(np.rint(frame * 255).clip(0, 255).astype(np.uint8))


@pytest.mark.parametrize("depth_mm", [370.0, 442.1, 700.0])
def test_factors_are_found_in_a_scene_at_any_depth(crooked_layout: Layout, depth_mm: float) -> None:
    found = measure([unequal(crooked_layout, depth_mm, waves, GAIN)])
    assert np.abs(found.gain * GAIN - 1.0).max() < 0.01
    assert (found.gain[1, 1] == 1.0).all()


def test_factors_are_found_on_a_plain_sheet(crooked_layout: Layout) -> None:
    found = measure([unequal(crooked_layout, 500.0, plain, GAIN)])
    assert np.abs(found.gain * GAIN - 1.0).max() < 0.007  # half a grey level of each


def test_one_outlying_frame_does_not_change_the_factors(crooked_layout: Layout) -> None:
    good = unequal(crooked_layout, 442.1, waves, GAIN)
    off = GAIN.copy()
    off[0] *= 0.6
    found = measure([good, unequal(crooked_layout, 442.1, waves, off), good])
    assert np.abs(found.gain * GAIN - 1.0).max() < 0.01


def test_a_decoder_with_the_factors_gives_equal_views(crooked_layout: Layout) -> None:
    equalisation = measure([unequal(crooked_layout, 442.1, waves, GAIN)])
    frame = photographed(crooked_layout, 600.0, plain)
    for (hit, _, _), factor in zip(reflected_rays(crooked_layout), GAIN.reshape(-1, 3), strict=True):
        frame[hit] *= factor
    decoder = Decoder(crooked_layout).equalised(equalisation)
    for samples, tolerance in (
        (decoder.decode(frame).samples, 0.007),
        (decoder.decode(np.rint(frame * 255).astype(np.uint8)).samples / 255.0, 0.012),
    ):
        inside = decoder.weights > 0
        assert np.abs(samples[inside] - 0.7).max() < tolerance
        assert not samples[~inside].any()


def test_eight_bit_factors_round_and_end_at_white() -> None:
    samples = np.tile(np.arange(256, dtype=np.uint8)[:, None], (1, 1, 1, 1, 3)).reshape(1, 1, 16, 16, 3)
    gain = np.array([[[0.5013, 1.0, 1.3007]]])
    made = samples.copy()
    Equalisation(layout_identity="a", gain=gain).apply(made)
    exact = np.minimum(samples * gain[:, :, None, None], 255.0)
    assert np.abs(made - exact).max() < 0.51
    grey = samples[..., :1].copy()
    Equalisation(layout_identity="a", gain=[[[1.3007]]]).apply(grey)
    assert np.array_equal(grey[..., 0], made[..., 2])


def test_impossible_factors_are_refused(crooked_layout: Layout, parabola_layout: Layout) -> None:
    decoder = Decoder(crooked_layout)
    height, width = crooked_layout.camera.height_px, crooked_layout.camera.width_px
    for value in (3, 255):
        light_field = decoder.decode(np.full((height, width, 3), value, np.uint8))
        with pytest.raises(
            InputError, match=r"^view \(0, 0\) has 0 px to compare brightness in, expected 40 px or more"
        ):
            measure([light_field])
    with pytest.raises(InputError, match=r"^no light field, expected at least one"):
        measure([])
    first = unequal(crooked_layout, 500.0, waves, GAIN)
    other = Decoder(parabola_layout).decode(np.zeros((540, 960, 3), np.uint8))
    with pytest.raises(InputError, match=r"^light field of layout [0-9a-f]{16}, expected"):
        measure([first, other])
    found = measure([first])
    with pytest.raises(InputError, match=r"^equalisation was measured with layout"):
        Decoder(parabola_layout).equalised(found)
    with pytest.raises(InputError, match=r"^frame has 1 colours, expected 3 of the equalisation"):
        Decoder(crooked_layout).equalised(found).decode(np.zeros((height, width), np.uint8))
    cut = Equalisation(layout_identity=found.layout_identity, gain=found.gain[:, :2])
    with pytest.raises(InputError, match=r"^equalisation has \(2, 2\) views, expected \(2, 3\)$"):
        Decoder(crooked_layout).equalised(cut)


def test_factors_survive_in_a_file(tmp_path: Path) -> None:
    made = Equalisation(layout_identity="0123456789abcdef", gain=GAIN)
    made.save(tmp_path / "e.json")
    read = Equalisation.load(tmp_path / "e.json")
    assert np.array_equal(read.gain, GAIN)
    assert read.exponent == 1.0
    assert "exponent" not in (tmp_path / "e.json").read_text(encoding="utf-8")
    made.replaced(exponent=0.45).save(tmp_path / "curved.json")
    assert Equalisation.load(tmp_path / "curved.json").exponent == 0.45
    (tmp_path / "bad.json").write_text('{"layout_identity": "a", "gain": [[[0.0]]]}', encoding="utf-8")
    with pytest.raises(InputError, match=r"bad.json: gain must lie within 0.05 to 20"):
        Equalisation.load(tmp_path / "bad.json")
    with pytest.raises(ValueError, match="gain has 2 colours"):
        Equalisation(layout_identity="a", gain=np.ones((1, 1, 2)))


def faded(views: Views, exponent: float, *, seed: int = 0, kind: type = np.uint8, least: float = 0.4) -> LightField:
    """Return a light field of a texture with a fading left border of 20 px, brightened as for a linear camera."""
    shape = views.rows, views.cols, views.height_px, views.width_px
    random = np.random.default_rng(seed)
    coarse = random.uniform(40.0, 120.0, (views.rows * views.cols, views.height_px // 8, views.width_px // 8))
    texture = np.stack([cv2.resize(each, (views.width_px, views.height_px)) for each in coarse]).reshape(shape)
    share = np.broadcast_to(np.clip(least + np.arange(views.width_px) * 0.03, 0.0, 1.0), shape).astype(np.float32)
    frame = np.rint(texture * share**exponent + random.normal(0.0, 1.0, shape))
    samples = np.clip(frame / share, 0.0, 255.0)[..., None]
    samples = np.rint(samples).astype(np.uint8) if kind is np.uint8 else (samples / 255.0).astype(np.float32)
    return LightField.of(views, samples, share)


@pytest.fixture(scope="module")
def views() -> Views:
    across, down = np.meshgrid([-20.0, 0.0, 20.0], [-20.0, 0.0, 20.0])
    return Views(
        positions_mm=np.stack([across, down, 0.0 * across], axis=-1),
        focal_px=600.0,
        centre_px=np.array([119.5, 79.5]),
        width_px=240,
        height_px=160,
        reference_depth_mm=400.0,
        reference_view_in_rig_mm=np.array([0.0, -80.0, 90.0]),
        view_from_rig=np.eye(3),
        layout_identity="0" * 16,
    )


@pytest.mark.parametrize("exponent", [1.0 / 2.2, 0.7, 1.3])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_an_exponent_is_found(views: Views, exponent: float, kind: type) -> None:
    found = fit_exponent([VignettedLevels.of(faded(views, exponent, seed=seed, kind=kind)) for seed in range(2)])
    assert found == pytest.approx(exponent, abs=0.03)


def test_a_linear_camera_is_recognised(views: Views) -> None:
    assert fit_exponent([VignettedLevels.of(faded(views, 1.0))]) == 1.0


def test_without_information_no_exponent_is_found(views: Views) -> None:
    assert fit_exponent([VignettedLevels.of(faded(views, 0.5, least=1.0))]) == 1.0
    light_field = faded(views, 0.5)
    dark = LightField.of(views, np.zeros_like(light_field.samples), light_field.weights)
    none = LightField.of(views, light_field.samples, np.zeros_like(light_field.weights))
    assert fit_exponent([VignettedLevels.of(dark), VignettedLevels.of(none)]) == 1.0
