"""Pictures of two boards, each visible in some of the mirrors."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.calibration import calibrate
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.optics.calibration.test_calibration import BOARD, CAMERA, draw, mirrored_pose
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import render


def test_pictures_of_two_boards_are_refused() -> None:
    nominal = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
    truth = draw(nominal, seed=4)
    pictures = [render(truth.camera, truth, BOARD, mirrored_pose(n), noise_grey=1.0, seed=n) for n in range(4)]
    half = CAMERA.width_px // 2
    both = [np.hstack([a[:, :half], b[:, half:]]) for a, b in zip(pictures, pictures[1:] + pictures[:1], strict=True)]
    with pytest.raises(InputError, match="two boards in view"):
        calibrate(both, [], nominal, BOARD)
