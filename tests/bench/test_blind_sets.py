"""A calibrator sees what anyone with the device would have, and nothing of the truth."""

from __future__ import annotations

import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.bench.calibrator_run import described_views, write_blind_set
from mirrorcam.bench.suite_folder import read_finished
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from mirrorcam.optics.geometry.layout import Layout
from tests.small_set import contents

pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")


def test_a_blind_set_has_pictures_layout_and_board_as_they_are(finished_suite: Path, tmp_path: Path) -> None:
    place = read_finished(finished_suite).folders[0]
    write_blind_set(place, tmp_path)
    found = contents(tmp_path)
    described = json.loads(found.pop("views.json"))
    assert sorted(found) == [
        *("base/0000.jpg", "board.toml", "frames/0000.jpg", "frames/0001.jpg", "frames/0002.jpg", "layout.json")
    ]
    assert found == {name: (place / name).read_bytes() for name in found}
    assert described["schema"] == "mirrorcam.device_views/1"


def test_what_a_calibrator_changes_there_leaves_the_set_alone(finished_suite: Path, tmp_path: Path) -> None:
    place = read_finished(finished_suite).folders[0]
    before = contents(place)
    write_blind_set(place, tmp_path)
    (tmp_path / "board.toml").write_text("other", encoding="utf-8")
    (tmp_path / "frames" / "0000.jpg").unlink()
    assert contents(place) == before


@pytest.mark.parametrize("name", ["board.toml", "frames/0001.jpg"])
def test_a_set_that_lacks_a_file_is_refused(finished_suite: Path, tmp_path: Path, name: str) -> None:
    place = tmp_path / "set"
    shutil.copytree(read_finished(finished_suite).folders[0], place)
    (place / name).unlink()
    with pytest.raises(InputError, match=f"{name}: no such file"):
        write_blind_set(place, tmp_path / "seen")


def test_views_are_the_parts_of_the_flipped_frame_that_mirrors_show(default_layout: Layout) -> None:
    described = described_views(default_layout)
    assert described.flip_code == 0
    for view, camera in zip(described.views, virtual_cameras(default_layout), strict=True):
        part = camera.sub_image
        outline = np.array(view.outline_px)
        assert (view.name, view.x, view.y, view.width, view.height) == (
            *(camera.name, part.x, part.y, part.width, part.height),
        )
        assert (outline > np.array([view.x, view.y]) - 1.0).all()
        assert (outline < np.array([view.x + view.width, view.y + view.height])).all()
        np.testing.assert_array_equal(view.camera_matrix, camera.camera.matrix)
