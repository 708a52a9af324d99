"""Formats are detected by content, and ambiguous input is refused in one line."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.read.registry import FORMATS, READERS, is_layout, read_rig, rig_of
from mirrorcam.optics.camera_files.write.write_exports import export_names
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.camera_files.rigs import EXACT, device, pose_of

DAMAGED = {"opencv.yaml", "kalibr_camchain.yaml", "ros", "colmap/sparse", "anipose"}
ODD = ("nan", "inf", "-1", "0", "1e308", "1e400", "99999999999999999999", "x", "", "-", "[", "\n", "\x00", "CAMERA")


@pytest.mark.parametrize(
    ("name", "format"),
    [
        ("opencv.yaml", "opencv"),
        ("kalibr_camchain.yaml", "kalibr"),
        ("ros", "ros"),
        ("ros/view_0_1.yaml", "ros"),
        ("colmap", "colmap"),
        ("colmap/sparse", "colmap"),
        ("colmap/sparse/cameras.txt", "colmap"),
        ("anipose", "anipose"),
        ("anipose/calibration.toml", "anipose"),
    ],
)
def test_formats_are_recognised(name: str, format: str, exported: Path) -> None:
    assert read_rig(exported / name).format == format


def test_a_layout_is_recognised_in_a_file_and_a_folder(tmp_path: Path) -> None:
    device().truth.save(tmp_path / "layout.json")
    (tmp_path / "metrics.json").write_text(json.dumps({"a": {"value": 1.0, "unit": "px"}}))
    for path in (tmp_path / "layout.json", tmp_path):
        rig = read_rig(path)
        assert rig.format == "mirrorcam"
        assert device().score(rig).figures["max_px"].value < 1e-9


def test_every_format_has_a_reader() -> None:
    assert set(READERS) == set(FORMATS)


def test_a_folder_of_several_formats_needs_one_to_be_named(exported: Path) -> None:
    with pytest.raises(InputError, match="calibrations as kalibr, opencv"):
        read_rig(exported)
    assert read_rig(exported, "kalibr").format == "kalibr"
    assert read_rig(exported, "colmap").format == "colmap"


def test_two_camchains_are_refused(exported: Path, tmp_path: Path) -> None:
    for name in ("a.yaml", "b.yaml"):
        shutil.copy(exported / "kalibr_camchain.yaml", tmp_path / name)
    with pytest.raises(InputError, match=r"several calibrations as kalibr \(a.yaml, b.yaml\)"):
        read_rig(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.yaml", "a: [1", "not valid YAML"),
        ("a.yaml", "!!python/object/apply:os.system ['touch hacked']", "not valid YAML"),
        ("a.yaml", "[" * 5000, "not valid YAML"),
        ("a.yaml", "a: 1", "no calibration in a known format"),
        ("a.json", "{", "not valid JSON"),
        ("a.xml", "<opencv_storage/>", "FileStorage in XML, expected YAML or JSON"),
        ("a.txt", "hello", "no calibration in a known format"),
    ],
)
def test_what_is_no_calibration_is_refused_in_one_line(name: str, content: str, complaint: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError) as caught:
        read_rig(tmp_path / name)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_missing_calibration_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_rig(tmp_path / "a.yaml")
    with pytest.raises(InputError, match="no calibration in a known format, expected kalibr or opencv"):
        read_rig(tmp_path)


def test_aliases_of_yaml_do_not_multiply(tmp_path: Path) -> None:
    """A billion laughs: nine levels of nine references each."""
    lines = ["a0: &a0 [1, 1]"] + [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    (tmp_path / "a.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match="more than 300000 values"):
        read_rig(tmp_path / "a.yaml")
    (tmp_path / "a.yaml").write_text("a: &a [1, *a]")
    with pytest.raises(InputError, match="an alias 'a' without an anchor"):
        read_rig(tmp_path / "a.yaml")


@pytest.mark.parametrize("name", [name for name in export_names(device().truth) if not name.endswith((".png", ".md"))])
def test_every_file_of_cameras_reads_back_with_the_same_geometry_or_is_refused_by_name(
    name: str, exported: Path
) -> None:
    try:
        rig = read_rig(exported / name)
    except InputError as error:
        assert name.endswith((".pickle", ".urdf", ".json", "images.txt", "rigs.txt", "frames.txt", "points3D.txt"))
        assert str(error).endswith("expected layout.json or opencv.yaml")
    else:
        figures = device().score(rig).figures
        assert figures["max_px"].value < EXACT
        if rig.unit_mm is not None and "baseline_error_max_mm" in figures:
            assert figures["baseline_error_max_mm"].value < EXACT


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", sorted(DAMAGED))
def test_a_file_with_odd_words_is_scored_or_refused_in_one_line(name: str, exported: Path, tmp_path: Path) -> None:
    refused = 0
    for seed in range(10):
        random = np.random.default_rng(seed)
        place = tmp_path / f"{seed}" / Path(name).name
        copy = shutil.copytree if (exported / name).is_dir() else shutil.copy
        place.parent.mkdir()
        copy(exported / name, place)
        files = sorted(place.iterdir()) if place.is_dir() else [place]
        file = files[int(random.integers(len(files)))]
        words = re.split(r"(?<=[ ,\[])", file.read_text(encoding="utf-8"))
        for _ in range(int(random.integers(1, 3))):
            words[int(random.integers(len(words)))] = str(random.choice(ODD)) + str(random.choice([" ", ", "]))
        file.write_text("".join(words), encoding="utf-8")
        try:
            figures = device().score(read_rig(place)).figures
        except InputError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            assert all(np.isfinite(figure.value) for figure in figures.values()) and figures["rms_px"].value >= 0.0
    assert refused


@pytest.mark.parametrize("numbers", ["1 0 0 0 0 0", "1e300 0 0 0 0 0 0", "1 0 0 0 1e300 0 0"])
def test_an_invalid_pose_of_colmap_is_refused(exported: Path, tmp_path: Path, numbers: str) -> None:
    shutil.copytree(exported / "colmap" / "sparse", tmp_path / "sparse")
    (tmp_path / "sparse" / "rigs.txt").unlink()
    images = tmp_path / "sparse" / "images.txt"
    lines = images.read_text().splitlines()
    place = next(number for number, line in enumerate(lines) if not line.startswith("#"))
    words = lines[place].split()
    lines[place] = " ".join([words[0], numbers, *words[8:]])
    images.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"pose|invalid COLMAP file"):
        read_rig(tmp_path / "sparse")


def test_a_layout_with_a_large_covariance_is_read(tmp_path: Path) -> None:
    path = tmp_path / "layout.json"
    path.write_text(device().truth.text() + " " * 2_000_000)
    assert read_rig(path).format == "mirrorcam"


def test_a_folder_of_large_files_is_refused_before_they_are_read(tmp_path: Path) -> None:
    for number in range(2):
        (tmp_path / f"{number}.yaml").write_text("a" * 3_000_000)
    with pytest.raises(InputError, match="more than 5 MB of YAML"):
        read_rig(tmp_path)


@pytest.mark.parametrize("name", ["ost.txt", "ost.ini", "head_camera.ini"])
def test_other_files_of_a_ros_calibrator_are_named(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("# oST version 5.0 parameters\n")
    with pytest.raises(InputError, match="camera_calibration's"):
        read_rig(tmp_path / name)


def test_cameras_project_as_the_mirrors_do() -> None:
    layout = device().truth.with_surface("second", 2.0)
    rig = rig_of(layout)
    points = np.random.default_rng(0).uniform([-80.0, 300.0, 0.0], [80.0, 500.0, 100.0], (50, 3))
    for number, camera in enumerate(rig.cameras):
        found = camera.lens.project(transform(pose_of(camera), points))
        np.testing.assert_allclose(found, layout.project(points, number), atol=1e-9)
        assert np.linalg.det(pose_of(camera)[:3, :3]) < 0.0
    assert (rig.pictures, rig.unit_mm, rig.uncertainty) == ("as-is", 1.0, None)


def test_layouts_are_recognised() -> None:
    assert is_layout({"schema": "mirrorcam.layout/1"})
    assert not is_layout({"schema": "mirrorcam.dataset/1"})
    assert not is_layout([])
