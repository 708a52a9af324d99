"""The manifest of a rendered set.

The true layout of a set: with the bends that its mirrors were rendered with, which scores count.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from mirrorcam.bench.score_request import Reading, ScoreRequest
from mirrorcam.bench.scoring import score
from mirrorcam.core.disk.files import write_json
from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.errors import InputError
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.sets.dataset import FINISH, MANIFEST, TRUE_LAYOUT, Dataset, true_layout
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorName
from tests.optics.camera_files.rigs import device
from tests.render_scenes.manifests import dataset_of_two_frames


def test_it_is_read_as_it_was_written(tmp_path: Path) -> None:
    dataset = dataset_of_two_frames()
    dataset.save(tmp_path)
    assert Dataset.load(tmp_path) == dataset
    assert '"schema": "mirrorcam.dataset/1"' in (tmp_path / MANIFEST).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("before", "after", "named"),
    [
        ("mirrorcam.dataset/1", "mirrorcam.dataset/9", "schema"),
        ('"frames": 2', '"frames": -2', "frames"),
        ('"tilt_deg": 0.3', '"tilt_deg": NaN', "tilt_deg"),
        ('"request"', '"requested"', "request"),
    ],
)
def test_what_does_not_belong_is_refused_by_name(tmp_path: Path, before: str, after: str, named: str) -> None:
    dataset_of_two_frames().save(tmp_path)
    path = tmp_path / MANIFEST
    path.write_text(path.read_text(encoding="utf-8").replace(before, after), encoding="utf-8")
    with pytest.raises(InputError, match=named):
        Dataset.load(tmp_path)


def test_a_folder_without_a_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        Dataset.load(tmp_path)


def test_a_file_is_intact_while_it_is_what_was_written(tmp_path: Path) -> None:
    picture = tmp_path / "frames" / "0000.png"
    picture.parent.mkdir()
    picture.write_bytes(b"picture")
    dataset = dataset_of_two_frames().replaced(files={"frames/0000.png": file_digest(picture)})
    assert dataset.intact(tmp_path, "frames/0000.png")
    assert not dataset.intact(tmp_path, "frames/0001.png")
    picture.write_bytes(b"pictur")
    assert not dataset.intact(tmp_path, "frames/0000.png")
    picture.unlink()
    assert not dataset.intact(tmp_path, "frames/0000.png")


@pytest.mark.parametrize(("sensor", "suffix"), [("ideal", ".png"), ("c920", ".jpg")])
def test_it_is_complete_with_every_frame(sensor: SensorName, suffix: str) -> None:
    dataset = dataset_of_two_frames().replaced(settings=RenderSettings(sensor=SENSORS[sensor]))
    assert dataset.frame_names == (f"frames/0000{suffix}", f"frames/0001{suffix}")
    assert dataset.base_names == (f"base/0000{suffix}",)
    most = dict.fromkeys(dataset.frame_names, "0")
    assert not dataset.replaced(files=most).complete
    assert dataset.replaced(files=most | {f"base/0000{suffix}": "0"}).complete


def test_maps_lie_in_the_truth_under_the_names_of_their_pictures() -> None:
    dataset = dataset_of_two_frames()
    assert dataset.map_of("frames/0001.jpg") == "truth/maps/frames/0001.exr"
    assert dataset.map_of("base/0000.png") == "truth/maps/base/0000.exr"
    assert dataset.replaced(settings=RenderSettings(maps=False)).map_of("frames/0001.jpg") is None


def test_the_manifest_needs_no_renderer() -> None:
    code = """
import sys
import mirrorcam.render_scenes.sets.dataset
sys.exit(any(name in sys.modules for name in ('mitsuba', 'drjit', 'casadi')))
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def make_set(folder: Path) -> Path:
    """The ground truth of a rendered set about its device."""
    device().nominal.save(folder / "layout.json")
    device().truth.save(folder / TRUE_LAYOUT)
    return folder


def test_flat_mirrors_are_as_they_are_there(tmp_path: Path) -> None:
    assert true_layout(make_set(tmp_path / "flat")) == device().truth


def test_mirrors_that_were_rendered_bent_are_the_truth(tmp_path: Path) -> None:
    folder = make_set(tmp_path / "bent")
    count = len(device().truth.mirrors)
    finishes = [MirrorFinish(reflectance=(0.9,) * 3, sag_mm=0.01 * (-1) ** k, ripple_mm=1e-5) for k in range(count)]
    write_json(folder / FINISH, {"mirrors": [each.model_dump(mode="json") for each in finishes]})
    bent = true_layout(folder)
    assert [mirror.curvature_per_m.any() for mirror in bent.mirrors] == [True] * count
    bent.save(tmp_path / "bent.json")
    device().truth.save(tmp_path / "flat.json")
    as_bent, as_flat = (
        score([folder], ScoreRequest(calibration=(tmp_path / name,)), Reading()).sets[0].figures["rms_px"].value
        for name in ("bent.json", "flat.json")
    )
    assert as_bent < 1e-9
    assert as_flat > 0.1
    write_json(folder / FINISH, {"mirrors": [finishes[0].model_dump(mode="json")]})
    with pytest.raises(InputError, match=rf"finish\.json: 1 finishes, expected {count}, one per mirror"):
        true_layout(folder)
