"""Pictures that are upside down are told from others that do not fit."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.detection.assignment import assign
from mirrorcam.optics.calibration.diagnostics.screening import screen
from mirrorcam.optics.calibration.diagnostics.upside_down import fits_upside_down
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco, Checkerboard
from tests.optics.calibration.synthetic_corners import as_built, mirrored_poses, views_of

MARKED = Charuco(cols=10, rows=7, square_mm=16.0, marker_mm=11.0)
PLAIN = Checkerboard(cols=9, rows=7, square_mm=6.0)


def shown(target: Checkerboard | Charuco, truth: Layout, nominal: Layout, *, upside_down: bool) -> list[Observations]:
    """What is found in frames, turned by 180 degrees or not."""
    last = np.array([nominal.camera.width_px, nominal.camera.height_px]) - 1.0
    frames = []
    for seen in views_of(truth, target, mirrored_poses(target, 6, tilt_deg=25.0, seed=1), [], seed=1).seen:
        pixels = last - seen.pixels if upside_down else seen.pixels
        boards = [(Corners(seen.corner[seen.view == v], pixels[seen.view == v]),) for v in np.unique(seen.view)]
        rows = [Observations.of_view(0, mirror, c.ids, c.pixels) for mirror, c in assign(boards, nominal, target)]
        frames.append(Observations.join(rows))
    return frames


@pytest.mark.parametrize("target", [MARKED, PLAIN])
def test_pictures_that_are_upside_down_fit_once_they_are_turned(
    target: Checkerboard | Charuco, fold_90_layout: Layout
) -> None:
    truth = as_built(fold_90_layout, seed=1)
    seen = shown(target, truth, fold_90_layout, upside_down=True)
    with pytest.raises(InputError):
        screen(seen, [], fold_90_layout, target.corners_in_board_mm)
    assert fits_upside_down(seen, fold_90_layout, target)


def test_other_pictures_do_not(fold_90_layout: Layout) -> None:
    seen = shown(MARKED, as_built(fold_90_layout, seed=1), fold_90_layout, upside_down=False)
    assert not fits_upside_down(seen, fold_90_layout, MARKED)
    assert not fits_upside_down([Observations.none()], fold_90_layout, MARKED)
