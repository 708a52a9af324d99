"""Calibration from arrays of corners that another detector found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.core.arguments import check_type
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import array_of
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners, check_names
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, Observations
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco, Checkerboard
from mirrorcam.optics.geometry.layout import Layout

GivenCorners: TypeAlias = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]
"""Numbers (n,) and pixels (n, 2) of the corners in one view, and if known their standard deviations (n,) in px."""


def calibrate_from_corners(
    frames: Iterable[Mapping[Any, GivenCorners]],
    base_frames: Iterable[GivenCorners],
    layout: Layout,
    board: CalibrationBoard,
    *,
    model: RequestedModel | str = AUTO,
    names: tuple[Sequence[str], Sequence[str]] | None = None,
) -> Calibration:
    """Calibrate a mirror camera from corners of another detector.

    Corners determine neither the pupil of the lens nor the outlines of the mirrors: both stay as in `layout`.

    Parameters
    ----------
    frames
        Corners in each picture via the mirrors, by view: the mirror's index, or its name in `Layout.mirror_names`, such
        as "0-2". The corners of a view are a pair of numbers (n,) and pixels (n, 2), or a triple with their standard
        deviations (n,) per axis, px. Corners are numbered row by row from 0 at the top left of the print; pixels are
        those of the picture as the camera gives it, with (0, 0) at the centre of the top-left pixel. Views with fewer
        than 6 corners are not used.
    base_frames
        Corners in each picture of the camera without mirrors, as such pairs or triples. May be empty.
    layout
        Nominal layout: the starting point of the fit.
    board
        The board.
    model
        Model to fit, as for `calibrate`.
    names
        Names of the pictures via the mirrors, and without them. Default: their numbers.

    Returns
    -------
    Calibration
        The calibrated layout in the rig frame, mm, with covariance and diagnostics.

    Raises
    ------
    InputError
        For an unknown view, a corner that the board does not have, or corners that do not determine camera and mirrors.
    """
    check_type("layout", layout, Layout)
    check_type("board", board, Checkerboard, Charuco, AprilGrid)
    reader = _Reader(layout, board)
    mirrored = [reader.picture(f"frames[{number}]", views) for number, views in enumerate(frames)]
    base = [reader.view(f"base_frames[{number}]", DIRECT, found) for number, found in enumerate(base_frames)]
    if not mirrored:
        raise InputError("frames: no pictures given")
    if names is not None:
        for group, pictures in zip(names, (mirrored, base), strict=True):
            check_names(group, len(pictures))
    calibration = calibrate_corners(
        mirrored,
        base,
        layout,
        board.corners_in_board_mm,
        model=RequestedModel.parse(model),
        names=None if names is None else [*names[0], *names[1]],
    )
    return replace(calibration, notes=(*reader.notes, *calibration.notes))


class _Reader:
    """Checks the corners of each view, and notes the views with too few."""

    def __init__(self, layout: Layout, board: CalibrationBoard) -> None:
        self.notes: list[str] = []
        self._names = layout.mirror_names
        self._views: dict[int | str, int] = {key: i for i, name in enumerate(self._names) for key in (i, name)}
        self._size = layout.camera.width_px, layout.camera.height_px
        self._corners = len(board.corners_in_board_mm)

    def picture(self, place: str, views: Mapping[Any, GivenCorners]) -> Observations:
        """The corners of a picture via the mirrors, as frame 0."""
        check_type(place, views, Mapping)
        found = dict[int, Observations]()
        for view, corners in views.items():
            index = None if isinstance(view, bool) else self._views.get(view)
            if index is None:
                known = f"0 to {len(self._names) - 1}, or {self._names[0]!r} to {self._names[-1]!r}"
                raise InputError(f"{place}: view {view!r}, expected {known}")
            if index in found:
                raise InputError(f"{place}: view {view!r} again, expected either {self._names[index]!r} or {index}")
            found[index] = self.view(f"{place}[{view!r}]", index, corners)
        return Observations.join([found[index] for index in sorted(found)])

    def view(self, place: str, view: int, corners: GivenCorners) -> Observations:
        """The corners of one view, as frame 0; empty if they are too few."""
        if not isinstance(corners, Sequence) or len(corners) not in (2, 3):
            raise InputError(f"{place}: expected a pair of numbers (n,) and pixels (n, 2), or these and sigmas (n,)")
        numbers = array_of(f"{place}, numbers", corners[0], None, finite=True)
        pixels = array_of(f"{place}, pixels", corners[1], None, 2, finite=True)
        sigmas = np.ones(len(numbers))
        if len(corners) == 3:
            sigmas = array_of(f"{place}, sigmas", corners[2], None, finite=True)
        if not len(numbers) == len(pixels) == len(sigmas):
            counts = f"{len(numbers)} numbers, {len(pixels)} pixels and {len(sigmas)} sigmas"
            raise InputError(f"{place}: {counts}, expected as many of each")
        unknown = [number for number in numbers.tolist() if number not in range(self._corners)]
        if unknown or len(set(numbers.tolist())) != len(numbers):
            wrong = f"corner {unknown[0]:g}" if unknown else "a corner twice"
            raise InputError(f"{place}: {wrong}, expected different whole numbers from 0 to {self._corners - 1}")
        outside = (pixels < -0.5).any(axis=1) | (pixels > np.array(self._size) - 0.5).any(axis=1)
        if outside.any():
            x, y = pixels[outside][0]
            raise InputError(
                f"{place}: pixel ({x:g}, {y:g}), expected one in the picture of {self._size[0]} x {self._size[1]}"
            )
        if not (sigmas > 0.0).all():
            raise InputError(f"{place}: sigma {sigmas.min():g}, expected positive ones")
        if len(numbers) < MIN_CORNERS:
            if len(numbers):
                self.notes.append(f"{place}: {len(numbers)} corners, not used; expected {MIN_CORNERS} or more")
            return Observations.empty()
        return Observations.of_view(0, view, numbers.astype(np.int64), pixels, sigmas)
