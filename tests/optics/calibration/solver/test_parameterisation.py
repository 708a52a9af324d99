"""Names and places of the parameters that a model leaves free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.optics.calibration.solver.parameterisation import FrameTerms, Model
from mirrorcam.optics.calibration.solver.residuals import Board, global_names
from mirrorcam.optics.geometry.camera import Camera
from tests.optics.calibration.solver.four_mirrors import four_mirrors

CAMERA = Camera.c920()


def test_models_name_what_they_free() -> None:
    board = Board.warped(np.array([[x, y, 0.0] for y in range(3) for x in range(4)]))
    names = Model(("k1", "fx_px"), thickness=True, curvature=True, board=board).parameters(CAMERA, 2)
    assert names[:4] == ("fx_px", "k1", "mirror 0 x_mm", "mirror 0 y_mm")
    assert names[-4:] == ("mirror 1 curvature_xy_per_m", "sheet_mm", "board mode 0_mm", "board mode 1_mm")
    assert len(names) == len(set(names)) == 2 + 2 * 6 + 1 + 2
    held = Model((), thickness=False, curvature=False, board=Board.rigid(board.corners_in_board_mm), mirrors=False)
    assert held.parameters(CAMERA, 2) == ()
    with pytest.raises(ValueError, match=r"unknown intrinsics k9, expected some of fx_px, "):
        Model(("k9",), thickness=False, curvature=False, board=board).parameters(CAMERA, 2)


def test_the_places_of_free_globals_are_those_of_their_names() -> None:
    model = Model(("cy_px",), thickness=True, curvature=False, board=Board.rigid(np.zeros((1, 3))))
    every = global_names(CAMERA.intrinsic_names, 3, 0)
    assert tuple(every[place] for place in model.free(CAMERA, 3)) == model.parameters(CAMERA, 3)
    assert (np.diff(model.free(CAMERA, 3)) > 0).all()


def test_frame_terms_name_their_numbers_and_weigh_them() -> None:
    truth = four_mirrors().truth
    frames = len(truth.rig_from_board)
    own = replace(truth, camera_turn=np.full((frames, 3), 0.02), bow_mm=np.full((frames, 3), 0.5))
    none, bow, both = FrameTerms(), FrameTerms(bow_per_mm=4.0), FrameTerms(100.0, 4.0)
    assert [len(terms.free) for terms in (none, bow, both)] == [6, 9, 12]
    assert bow.free[6:].tolist() == [9, 10, 11]
    np.testing.assert_allclose(none.values(own), 0.0)
    np.testing.assert_allclose(both.values(own)[0], [*[0.0] * 6, *[2.0] * 3, *[2.0] * 3])
