"""The export folder: pictures, reproducible bytes, refusals, and the README."""

from __future__ import annotations

import json
import re
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.names import LONGEST
from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.camera_files.write import write_exports
from mirrorcam.optics.camera_files.write.write_exports import export_names
from mirrorcam.optics.geometry.layout import Layout
from tests.hostile_names import ACCEPTED, REFUSED
from tests.optics.camera_files.write.conftest import Case, sideways_layout


def test_pictures_are_the_flipped_frame(case: Case, folder: Path) -> None:
    frame = read_image(folder.parent / "a.png")
    for view in case.views:
        flipped = frame[:, ::-1] if view.flip == "left-right" else frame[::-1]
        for name in ("a.png", "b.png"):
            image = read_image(folder / "colmap" / "images" / view.name / name)
            mask = read_image(folder / "colmap" / "masks" / view.name / f"{name}.png", grey=True)
            np.testing.assert_array_equal(image[mask > 0], flipped[mask > 0])
            assert not image[mask == 0].any()
        part = read_image(folder / "nerfstudio" / "images" / f"{view.name}.png")
        np.testing.assert_array_equal(part, flipped[view.sub_image.slices])


def test_the_same_layout_makes_the_same_bytes(case: Case, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_exports(case.layout, tmp_path / name)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert len(files) > 10
    assert {path.as_posix() for path in files} == set(export_names(case.layout))
    for path in files:
        assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes()


def test_the_names_of_pictures_are_known_before_they_are_written(case: Case, folder: Path) -> None:
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert files == set(export_names(case.layout, [folder.parent / "a.png", folder.parent / "b.png"]))


def test_a_picture_of_another_size_is_refused(case: Case, tmp_path: Path) -> None:
    write_image(tmp_path / "small.png", np.zeros((10, 20), dtype=np.uint8))
    with pytest.raises(InputError, match=r"small.png: 20x10 px, expected \d+x\d+ of the layout's camera"):
        write_exports(case.layout, tmp_path / "exports", [tmp_path / "small.png"])


def test_pictures_that_share_a_name_are_refused(case: Case, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pictures share a name"):
        write_exports(case.layout, tmp_path / "exports", [tmp_path / "x" / "a.png", tmp_path / "y" / "a.png"])


def test_the_readme_names_flip_and_every_view(case: Case, folder: Path) -> None:
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert f"flipped\n{case.views[0].flip}" in text
    lines = [line for line in text.splitlines() if line.startswith("| view_")]
    assert len(lines) == len(case.views)
    assert len({line.split("|")[1] for line in lines}) == len(lines)
    for before, after in pairwise(lines):
        assert before < after


def test_ffmpeg_takes_frames_as_they_lie_on_the_sensor(folder: Path) -> None:
    """ffmpeg rotates a phone's video with a rotation flag, unless an option prevents it."""
    texts = [(folder / name).read_text(encoding="utf-8") for name in ("README.md", "anipose/calibration.toml")]
    lines = [line for text in texts for line in text.splitlines() if "ffmpeg" in line and " -vf " in line]
    assert len(lines) > 1
    assert all("ffmpeg -noautorotate -i FRAMES " in line for line in lines)
    assert "ffmpeg -i" not in "".join(texts)


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", [ACCEPTED[3], "'\": {[# ä 鏡 🪞", "W" * LONGEST])
def test_no_export_holds_the_name_of_the_camera(name: str, tmp_path: Path) -> None:
    """The readers of the other tests find the same for any camera."""
    layout = sideways_layout()
    named = layout.replaced(camera=layout.camera.replaced(name=name))
    write_exports(layout, tmp_path / "plain")
    write_exports(named, tmp_path / "named")
    assert files_of(tmp_path / "named") == files_of(tmp_path / "plain")


def test_colmap_finds_pictures_of_any_name(tmp_path: Path) -> None:
    layout = sideways_layout()
    frame = np.zeros((layout.camera.height_px, layout.camera.width_px), dtype=np.uint8)
    write_image(tmp_path / "plain.png", frame)
    odd = {name.replace("/", "_").replace("\x00", "_") for name in (*ACCEPTED, *REFUSED)} - {"", "x" * 300}
    names = [name.encode("utf-8", "replace").decode() for name in sorted(odd)] + ["-rf", "..", "x" * 247]
    for number, name in enumerate(names):
        picture = tmp_path / f"{name}.png"
        shutil.copy(tmp_path / "plain.png", picture)
        write_exports(layout, tmp_path / str(number), [picture])
        colmap = tmp_path / str(number) / "colmap"
        found = [image.name for image in pycolmap.Reconstruction(colmap / "sparse").images.values()]
        assert len(found) == len(layout.mirrors)
        assert all((colmap / "images" / each).is_file() for each in found)
        assert all((colmap / "masks" / f"{each}.png").is_file() for each in found)


def test_a_picture_whose_mask_would_have_too_long_a_name_is_refused(tmp_path: Path) -> None:
    layout = sideways_layout()
    picture = tmp_path / f"{'x' * 251}.png"
    write_image(tmp_path / "plain.png", np.zeros((layout.camera.height_px, layout.camera.width_px), dtype=np.uint8))
    shutil.copy(tmp_path / "plain.png", picture)
    with pytest.raises(InputError, match="cannot be written: File name too long"):
        write_exports(layout, tmp_path / "exports", [picture])


def test_colmap_reads_the_names_of_pictures_with_blanks(case: Case, tmp_path: Path) -> None:
    camera = case.layout.camera
    picture = tmp_path / "my photo 1.png"
    write_image(picture, np.zeros((camera.height_px, camera.width_px), dtype=np.uint8))
    write_exports(case.layout, tmp_path / "exports", [picture])
    model = pycolmap.Reconstruction(tmp_path / "exports" / "colmap" / "sparse")
    names = sorted(image.name for image in model.images.values())
    assert names == [f"{view.name}/my_photo_1.png" for view in case.views]
    assert all((tmp_path / "exports" / "colmap" / "images" / name).is_file() for name in names)
    with pytest.raises(InputError, match="pictures share a name"):
        write_exports(case.layout, tmp_path / "exports", [picture, tmp_path / "my_photo_1.png"])


LENSES = {"brown_conrady": 5, "rational": 8, "thin_prism": 12, "fisheye": 4}


def odd_layout(seed: int) -> Layout | None:
    """A layout with a random lens and up to two absurd numbers; None if it is refused."""
    random = np.random.default_rng(seed)
    tables = json.loads(sideways_layout().model_dump_json(by_alias=True))
    lens_model = str(random.choice(list(LENSES)))
    distortion = random.normal(size=LENSES[lens_model]) * 10.0 ** random.uniform(-6.0, 3.0)
    tables["camera"] |= {"lens_model": lens_model, "distortion": distortion.tolist()}
    for mirror in tables["mirrors"]:
        mirror |= {"surface": str(random.choice(["first", "second"])), "thickness_mm": 10.0 ** random.uniform(-3, 1)}
    places = [tables["camera"], *(mirror for mirror in tables["mirrors"])]
    for _ in range(int(random.integers(0, 3))):
        place = places[int(random.integers(len(places)))]
        name = str(random.choice([key for key, value in place.items() if isinstance(value, float)]))
        place[name] = float(random.choice([-1e6, -1e7, 0.0, 1e-3, 1e6, 1e7, 1e300, place[name] * 1e3]))
    try:
        return Layout.model_validate_json(json.dumps(tables))
    except InvalidValue:
        return None


@pytest.mark.filterwarnings("error")
def test_any_layout_that_is_read_is_written_in_finite_numbers_or_refused(tmp_path: Path) -> None:
    written = refused = 0
    for seed in range(60):
        if (layout := odd_layout(seed)) is None:
            continue
        try:
            write_exports(layout, tmp_path / f"{seed}")
        except InputError as error:
            assert "\n" not in str(error)
            refused += 1
            continue
        written += 1
        for path in (tmp_path / f"{seed}").rglob("*.*"):
            if path.suffix in (".yaml", ".toml", ".json", ".txt", ".urdf"):
                assert not re.search(r"\b(nan|inf)\b", path.read_text(encoding="utf-8"), re.IGNORECASE), path
    assert written > 3 and refused > 3


def test_a_lens_that_bends_without_bounds_is_refused(tmp_path: Path) -> None:
    layout = sideways_layout()
    endless = layout.replaced(camera=layout.camera.replaced(distortion=[1e5, -0.1, 2e-4, 7e-4, 0.0]))
    with pytest.raises(InputError, match=r"view_0_0 .* lens model"):
        write_exports(endless, tmp_path)
