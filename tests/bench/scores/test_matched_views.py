"""Which camera is which mirror, and which pixels its pictures are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.bench.scores.matched_views import ViewPosition, ViewsFile, matched_views, view_of
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.camera_rig import CameraRig, RigCamera
from mirrorcam.optics.camera_files.write.pose_cameras import pose_cameras
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from tests.optics.camera_files.rigs import EXACT, changed, device, lens_of, true_rig


@pytest.mark.parametrize(
    ("name", "view"),
    [
        ("view_1_0", 3),
        ("mirrorcam_view_0_2_optical_frame", 2),
        ("1-2", 5),
        ("cam0", 0),
        ("cam_4", 4),
        ("camera-5", 5),
        ("3", 3),
    ],
)
def test_names_of_mirrors(name: str, view: int) -> None:
    assert view_of(name, device().nominal) == view


@pytest.mark.parametrize("name", ["left", "cam6", "view_2_0", "view_0_3", "view_0_0 view_0_1", ""])
def test_names_of_no_mirror(name: str) -> None:
    with pytest.raises(InputError, match="names no mirror, expected view_0_0 to view_1_2, 0 to 5, or --views"):
        view_of(name, device().nominal)


def named(rig: CameraRig, *names: str) -> CameraRig:
    return replace(
        rig, cameras=tuple(replace(camera, name=name) for camera, name in zip(rig.cameras, names, strict=False))
    )


def test_a_file_of_views_names_them(tmp_path: Path) -> None:
    rig = named(true_rig(device().truth), "a", "b", "c")
    path = tmp_path / "views.toml"
    path.write_text('pictures = "flipped"\n[cameras]\na = "view_0_0"\nb = { view = "0-1" }\n')
    views = ViewsFile.load(path)
    score = device().score(rig, views=views)
    assert score.views == {"view_0_0": "a", "view_0_1": "b"}  # those that it names
    assert score.figures["max_px"].value < EXACT
    path.write_text('[cameras]\nz = "view_0_0"\n')
    with pytest.raises(InputError, match="camera 'z' of the views file is not in the calibration, which has a, b, c"):
        device().score(rig, views=ViewsFile.load(path))
    path.write_text('[camera]\na = "view_0_0"\n')
    with pytest.raises(InputError, match="camera: not known, did you mean cameras"):
        ViewsFile.load(path)


def test_two_cameras_of_one_mirror_are_refused() -> None:
    with pytest.raises(InputError, match="'view_0_1' and 'cam1' are both view_0_1"):
        device().score(named(true_rig(device().truth), "view_0_1", "cam1"))


@pytest.mark.parametrize("margin", [False, True])
def test_pictures_that_mirrorcam_cameras_cuts_are_known_by_their_size(margin: bool) -> None:
    """The nominal layout says how; the calibration is of the device as built."""
    nominal = virtual_cameras(device().nominal)
    cuts = (
        [each.crop for each in pose_cameras(device().nominal, nominal)]
        if margin
        else [view.sub_image for view in nominal]
    )
    cameras = []
    for camera, cut in zip(true_rig(device().truth).cameras, cuts, strict=True):
        lens = lens_of(camera)
        cropped = lens.replaced(
            width_px=cut.width, height_px=cut.height, cx_px=lens.cx_px - cut.x, cy_px=lens.cy_px - cut.y
        )
        cameras.append(replace(camera, lens=cropped, size_px=(cut.width, cut.height)))
    score = device().score(CameraRig("test", tuple(cameras), 1.0))
    assert score.figures["max_px"].value < EXACT


def test_pictures_that_the_user_cuts_are_placed_by_the_file_of_views() -> None:
    rig = true_rig(device().truth)
    lens = lens_of(rig.cameras[1])
    cropped = lens.replaced(width_px=400, height_px=300, cx_px=lens.cx_px - 250, cy_px=lens.cy_px - 10)
    rig = changed(rig, 1, lens=cropped, size_px=(400, 300))
    places: dict[str, str | ViewPosition] = {camera.name: camera.name for camera in rig.cameras}
    places["view_0_1"] = ViewPosition(view="view_0_1", x=250, y=10)
    assert device().score(rig, views=ViewsFile(cameras=places)).figures["max_px"].value < EXACT
    with pytest.raises(InputError, match="pictures of 400x300 px, expected the frame's 960x600, the view's"):
        device().score(rig)
    places["view_0_1"] = ViewPosition(view="view_0_1", x=600, y=10)
    with pytest.raises(InputError, match=r"400x300 px at \(600, 10\) is beyond the frame of 960x600"):
        device().score(rig, views=ViewsFile(cameras=places))


def test_pictures_of_another_camera_are_refused() -> None:
    rig = changed(true_rig(device().truth), 0, size_px=(1920, 1080))
    with pytest.raises(InputError, match="'view_0_0': pictures of 1920x1080 px, expected the frame's 960x600"):
        device().score(rig)


def test_what_a_file_says_of_its_pictures_is_not_overridden_unnoticed() -> None:
    rig = replace(true_rig(device().truth), pictures="top-bottom")
    assert device().score(rig, pictures="flipped").figures["max_px"].value < EXACT  # the same here
    with pytest.raises(
        InputError, match="--flip as-is: the calibration states top-bottom, expected the same or no --flip"
    ):
        device().score(rig, pictures="as-is")


def test_true_poses_are_those_of_the_exports() -> None:
    rig = true_rig(device().truth)
    for view, exported in zip(
        matched_views(rig, device().truth, device().nominal), virtual_cameras(device().truth), strict=True
    ):
        np.testing.assert_allclose(view.true_camera_from_rig, exported.camera_from_rig, atol=1e-12)
        assert view.name == exported.name


def test_a_camera_without_a_size_is_of_the_whole_frame() -> None:
    cameras = tuple(
        RigCamera(each.name, each.lens, each.camera_from_rig, None) for each in true_rig(device().truth).cameras
    )
    assert device().score(CameraRig("test", cameras, 1.0)).figures["max_px"].value < EXACT
