"""aniposelib's file: our exports score zero; other files are read, or refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.read.anipose import is_anipose, read_anipose, read_value
from mirrorcam.optics.camera_files.write import write_exports
from mirrorcam.optics.camera_files.write.pose_cameras import FFMPEG
from tests.optics.camera_files.rigs import EXACT, device
from tests.optics.camera_files.write.conftest import sideways_layout

CAMERA: dict[str, Any] = {
    "name": "A",
    "size": [640, 480],
    "matrix": [[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]],
    "distortions": [0.1, 0.0, 0.0, 0.0, 0.0],
    "rotation": [0.1, 0.2, 0.3],
    "translation": [10.0, 20.0, 30.0],
}


def written(folder: Path, **changes: Any) -> Path:
    path = folder / "calibration.toml"
    lines = [f"{key} = {json.dumps(value)}" for key, value in (CAMERA | changes).items() if value is not None]
    path.write_text("\n".join(["[cam_0]", *lines, "[metadata]", "error = 0.3"]))
    return path


def test_our_own_scores_zero(exported: Path) -> None:
    rig = read_anipose(exported / "anipose" / "calibration.toml")
    score = device().score(rig)
    assert len(score.views) == 6 and not score.notes
    assert score.figures["max_px"].value < EXACT
    assert score.figures["baseline_error_max_mm"].value < EXACT


def test_files_of_an_older_version_score_zero(exported: Path, tmp_path: Path) -> None:
    text = (exported / "anipose" / "calibration.toml").read_text()
    (tmp_path / "calibration.toml").write_text(text.replace(FFMPEG, "ffmpeg -i FRAMES"))
    assert device().score(read_anipose(tmp_path / "calibration.toml")).figures["max_px"].value < EXACT


def test_a_direct_view_is_left_out_and_a_frame_flipped_left_right_is_so(tmp_path: Path) -> None:
    write_exports(sideways_layout(), tmp_path)
    rig = read_anipose(tmp_path / "anipose" / "calibration.toml")
    assert [camera.name for camera in rig.cameras] == ["view_0_0", "view_0_1"]
    assert rig.pictures == "left-right"
    assert "direct" in rig.notes[0]


def test_without_comments_pictures_have_their_size(exported: Path, tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    lines = (exported / "anipose" / "calibration.toml").read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith("#")))
    rig = read_anipose(path)
    assert all(camera.size_px is not None for camera in rig.cameras)
    assert rig.pictures is None
    assert "mm" in rig.notes[0]


@pytest.mark.parametrize(
    ("fisheye", "distortions", "lens"), [(None, [0.1] * 5, "brown_conrady"), (True, [0.1] * 4, "fisheye")]
)
def test_a_camera_of_others_is_read(tmp_path: Path, fisheye: bool | None, distortions: list[float], lens: str) -> None:
    path = written(tmp_path, fisheye=fisheye, distortions=distortions)
    assert is_anipose(read_value(path))
    (camera,) = read_anipose(path).cameras
    assert camera.lens.lens_model == lens  # type: ignore[attr-defined]
    assert camera.camera_from_rig is not None
    np.testing.assert_array_equal(camera.camera_from_rig[:3, 3], [10.0, 20.0, 30.0])


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"rotation": None}, "rotation is missing"),
        ({"rotation": [0.0, 1.0]}, "rotation: 2 numbers, expected 3"),
        ({"size": [0, 480]}, "expected the size of a picture"),
        ({"matrix": [[1.0]]}, "expected .fx 0 cx"),
        ({"distortions": "no"}, "expected numbers"),
        ({"name": "direct"}, "contains no mirror"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(tmp_path: Path, changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        read_anipose(written(tmp_path, **changes))
    assert "\n" not in str(caught.value)
