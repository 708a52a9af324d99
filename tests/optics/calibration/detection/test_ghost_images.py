"""Corners in second-surface mirrors: the ghost images that the front adds must not move them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.optics.base.pictures import read_image
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection import detect_boards, ghost_images
from mirrorcam.optics.calibration.detection.board_growing import expected_corners
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.corner_patches import Appearance
from mirrorcam.optics.calibration.detection.corner_refinement import refine
from mirrorcam.optics.calibration.detection.detect_boards import sub_images
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.targets import Charuco
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from tests.optics.layouts import faceted_parabola

CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
BOARD = Charuco(cols=16, rows=11, square_mm=14.0, marker_mm=8.75)
FRONT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)


def second_surface(mirror: Mirror) -> Mirror:
    return Mirror.second_surface(
        mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=3.0, refractive_index=1.49
    )


NOMINAL = FRONT.replaced(mirrors=tuple(second_surface(mirror) for mirror in FRONT.mirrors), spec=None)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Grey], FloatArray]:
    """Pictures of a device that is not quite the nominal one, and the corners (frames, mirrors, corners, 2) in px."""
    folder: Path = tmp_path_factory.mktemp("sheets") / "set"
    request = SetRequest(
        layout=NOMINAL,
        target=BOARD,
        frames=3,
        base_frames=0,
        seed=3,
        tolerances=Tolerances(tilt_deg=0.5),
        settings=RenderSettings(renderer="fast", sensor=SENSORS["c920"], maps=False),
    )
    dataset = render_set(request, folder)
    with np.load(folder / "truth" / "corners.npz") as truth:
        return [read_image(folder / name, grey=True) for name in dataset.frame_names], truth["frames_px"]


def mean_errors(seen: list[Observations], truth_px: FloatArray) -> FloatArray:
    """Mean error (mirrors, 2) of the corners of each mirror, in px."""
    off = np.concatenate([o.pixels - truth_px[frame][o.view, o.corner] for frame, o in enumerate(seen)])
    view = np.concatenate([o.view for o in seen])
    return np.array([off[view == index].mean(axis=0) for index in range(truth_px.shape[1])])


def boards_of(seen: Observations) -> list[tuple[int, Corners]]:
    views = np.unique(seen.view).tolist()
    return [(view, Corners(seen.corner[seen.view == view], seen.pixels[seen.view == view])) for view in views]


def test_the_ghost_of_the_front_moves_no_corner(
    frames: tuple[list[Grey], FloatArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures, truth = frames
    seen = [sub_images(picture, NOMINAL, BOARD).corners for picture in pictures]
    assert np.abs(mean_errors(seen, truth)).max() < 0.006
    # What it would do to them: along the plane of incidence, in all mirrors the same way.
    with monkeypatch.context() as patched:
        patched.setattr(detect_boards, "refine_with_ghost_images", lambda picture, views, *_: list(views))
        pulled = [sub_images(picture, NOMINAL, BOARD).corners for picture in pictures]
    assert (mean_errors(pulled, truth)[:, 1] > 0.015).all()
    assert sum(map(len, seen)) > 0.7 * sum(map(len, pulled))


def test_ghost_images_are_where_the_plate_puts_them_and_as_strong(frames: tuple[list[Grey], FloatArray]) -> None:
    pictures, _ = frames
    factors = []
    for picture in pictures:
        for view, corners in boards_of(sub_images(picture, NOMINAL, BOARD).corners):
            ghosts = ghost_images.ghost_images_of(corners, CAMERA, NOMINAL.mirrors[view], BOARD)
            assert ghosts is not None
            assert 0.03 < ghosts.strengths[:, :2].min() < ghosts.strengths.max() < 0.12
            np.testing.assert_allclose(ghosts.strengths[:, 2], ghosts.strengths[:, 1] ** 2)
            # One before and one behind the picture, across the mirror's own slope, by about the same.
            before, behind, further = np.moveaxis(ghosts.offsets_px, 1, 0)
            assert np.abs(further - 2.0 * behind).max() < 0.2
            assert np.abs(before + behind).max() < 0.1
            assert (before[:, 1] > 2.0).all()
            expected = expected_corners(corners, BOARD)
            assert expected is not None
            seen = refine(picture.astype(np.float32), expected, Appearance(BOARD, 1.2, ghosts, fit_strengths=True))
            factors.append(np.median(seen.ghost_strengths, axis=0))
    assert np.abs(np.median(factors, axis=0) - 1.0).max() < 0.3


def test_a_first_surface_mirror_has_no_ghost_image() -> None:
    corners = Corners(np.arange(12), np.random.default_rng(0).uniform(100.0, 200.0, (12, 2)))
    picture = np.zeros((540, 960), dtype=np.uint8)
    ((mirror, seen),) = ghost_images.refine_with_ghost_images(picture, [(0, corners)], FRONT, BOARD)
    assert mirror == 0
    assert seen is corners
