"""The camera library: every file against published figures, reading by name and file, and refusals."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import (
    CAMERAS,
    MAX_DISAGREEMENT,
    CameraProfile,
    camera_names,
    library,
    profile_of,
    read_body,
    read_camera,
    read_profile,
)

WITH_OPTICS = [name for name, profile in library().items() if profile.optics]
PROFILE = """
name = "mine"
sensor_px_per_px = 2.0
[optics]
width_px = 1000
height_px = 800
fx_px = 1000.0
aperture_mm = 2.0
[published]
focal_mm = 4.0
f_number = 2.0
pixel_um = 2.0
horizontal_deg = 53.13
view_px = [2000, 1600]
[[sources]]
title = "a ruler"
url = "https://example.org/ruler"
gives = "everything"
[body]
width_mm = 40.0
height_mm = 30.0
depth_mm = 20.0
pupil_behind_front_mm = 3.0
lens_ring_mm = 8.0
lens_protrusion_mm = 1.0
cable_mm = 4.0
mass_g = 50.0
[body.held_by]
kind = "lips"
lip_mm = 2.0
"""


def written(folder: Path, text: str = PROFILE, name: str = "mine.toml") -> str:
    """Write a text to a file and return its path."""
    (folder / name).write_text(text, encoding="utf-8")
    return str(folder / name)


def test_there_are_cameras_of_every_kind_with_optics_and_names_of_their_own() -> None:
    assert len(WITH_OPTICS) >= 14
    assert len({profile.name for profile in library().values()}) == len(camera_names())
    assert {"c920", "c922", "brio", "pi_hq_m12", "pi_hq_cs", "pi_camera_3", "oak_d", "d435"} <= set(WITH_OPTICS)


@pytest.mark.parametrize("name", camera_names())
def test_every_file_reads_by_its_name_and_by_its_path(name: str) -> None:
    profile = read_profile(name)
    path = CAMERAS / f"{name}.toml"
    assert read_profile(str(path)) == profile
    assert read_body(name) == read_body(str(path)) == profile.body
    assert profile.body.name == profile.name
    assert profile.sources


@pytest.mark.parametrize("name", WITH_OPTICS)
def test_optics_agree_with_what_is_published(name: str) -> None:
    """Fields of view, focal length and f-number agree within 3 %; figures set aside, with a reason, do not."""
    profile = read_profile(name)
    assert profile.disagreements
    for figure, relative in profile.disagreements.items():
        assert (abs(relative) > MAX_DISAGREEMENT) == (figure in profile.set_aside), figure
    assert profile.published.f_number or "aperture_mm" in profile.guessed


@pytest.mark.parametrize("name", WITH_OPTICS)
def test_a_camera_is_one_that_a_design_can_be_made_for(name: str) -> None:
    camera = read_camera(name)
    assert camera == read_camera(str(CAMERAS / f"{name}.toml"))
    assert camera.body_mm == read_body(name).box_mm
    assert (camera.fx_px, camera.cx_px) == (camera.fy_px, (camera.width_px - 1) / 2.0)
    assert 0.5 < camera.aperture_mm < 6.0
    view = [math.degrees(2.0 * math.atan(size / camera.fx_px / 2.0)) for size in (camera.width_px, camera.height_px)]
    np.testing.assert_allclose(read_body(name).field_of_view_deg or (), view, atol=0.051)
    assert 30.0 < view[0] < 90.0


def test_the_default_camera_is_that_of_the_library_to_the_bit() -> None:
    assert read_camera("c920").model_dump_json() == Camera.c920().model_dump_json()
    assert read_body("c920").field_of_view_deg == (70.4, 43.3)


def test_figures_of_a_file_are_compared_with_the_sensor_behind_its_pictures(tmp_path: Path) -> None:
    """4 mm / 2 um are 2000 px of the sensor, so 1000 px when binned 2 x 2; 4 mm at f/2 has an aperture of 2 mm."""
    profile = read_profile(written(tmp_path))
    assert profile.disagreements == pytest.approx({"horizontal_deg": 0.0, "focal_mm": 0.0, "f_number": 0.0}, abs=1e-5)
    other = profile.replaced(sensor_px_per_px=1.0)
    assert other.disagreements["focal_mm"] == pytest.approx(-0.5)


def test_an_own_camera_is_a_profile_or_the_optics_or_the_body_alone(tmp_path: Path) -> None:
    path = written(tmp_path)
    assert read_camera(path).body_mm == ((-20.0, -15.0, -17.0), (20.0, 15.0, 3.0))
    assert read_body(path).field_of_view_deg == (53.1, 43.6)
    optics = Camera.c920().replaced(name="own")
    assert read_camera(written(tmp_path, optics.model_dump_json(), "own.json")) == optics
    body = PROFILE.partition("[body]")[2].replace("[body.held_by]", "[held_by]")
    assert read_body(written(tmp_path, f'name = "mine"\n{body}', "body.toml")) == read_body(path).replaced(
        field_of_view_deg=None
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx_px = 1000.0", 'fx_px = "long"', r"mine\.toml: optics\.fx_px: "),
        ("fx_px = 1000.0", "fx_px = -1.0", r"mine\.toml: optics\.fx_px: "),
        ("width_px = 1000", "width_px = 0", r"mine\.toml: optics\.width_px: "),
        ("width_px = 1000\n", "", r"mine\.toml: optics\.(width|cx)_px: "),
        ("fx_px = 1000.0", "fx_px = 1000.0\nbody_mm = [[0, 0, 0], [1, 1, 1]]", "optics.body_mm is given"),
        ('name = "mine"', 'name = "mine"\nguessed = ["lens"]', "guessed: lens is not a field"),
        ("cable_mm = 4.0", 'cable_mm = 4.0\nguessed = ["lens"]', "guessed: lens is not a dimension of a body"),
        ("[published]", '[set_aside]\nvertical_deg = "why"\n[published]', "set_aside: vertical_deg is not published"),
        ("https://example.org/ruler", "a ruler", r"mine\.toml: sources\.0\.url: "),
        ('"a ruler"', '"a \\u001b[31m ruler"', r"sources\.0\.title: .*cannot be printed"),
        ('kind = "lips"', 'kind = "glue"', r"mine\.toml: body\.held_by"),
        ("pixel_um", "pitch_um", r"mine\.toml: published\.pitch_um: not known"),
    ],
)
def test_errors_in_a_file_are_reported_in_one_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in PROFILE
    path = written(tmp_path, PROFILE.replace(old, new, 1))
    for read in (read_profile, read_camera, read_body):
        with pytest.raises(InputError, match=message) as caught:
            read(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["other", "../cameras/c920", "a" * 10_000, "a\0b", ""])
def test_a_camera_is_taken_by_a_known_name_alone(name: str) -> None:
    for read in (read_profile, read_camera, read_body):
        with pytest.raises(InputError, match=r"camera '.*': expected one of .*, c920, .*, or a \.toml") as caught:
            read(name)
        assert len(str(caught.value)) < 300


def test_a_board_for_any_lens_has_a_body_and_no_optics() -> None:
    assert read_body("board_38").field_of_view_deg is None
    with pytest.raises(InputError, match=r"38 mm USB board, M12 lens: the focal length is unknown"):
        read_camera("board_38")
    with pytest.raises(ValueError, match="fx_px is not a field of the optics"):
        read_profile("board_38").replaced(guessed=("fx_px",))


def test_the_camera_of_a_layout_is_known_by_its_name_calibrated_or_binned() -> None:
    camera = read_camera("d435")
    profile = profile_of(camera)
    assert isinstance(profile, CameraProfile)
    assert profile.name == "Intel RealSense D435, colour"
    assert profile_of(camera.replaced(fx_px=1390.0)) == profile_of(camera.binned(0.5)) == profile
    assert profile_of(camera.replaced(name="mine")) is None
    assert profile_of(camera.replaced(name="Intel RealSense D435, colour 2")) is None


def test_the_documentation_says_which_figures_are_from_memory() -> None:
    text = (Path(__file__).parents[3] / "docs" / "cameras.md").read_text(encoding="utf-8")
    table = text[text.index("| camera | figures from memory |") :].split("\n\n")[0].splitlines()[2:]
    recalled = {
        name: "; ".join(source.gives for source in profile.sources if source.from_memory)
        for name, profile in library().items()
    }
    assert table == [f"| `{name}` | {figures} |" for name, figures in recalled.items() if figures]
