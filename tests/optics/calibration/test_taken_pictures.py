"""Pictures as they are read: damaged files, sizes, and what is kept to look for another board."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration import taken_pictures
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.taken_pictures import TakenPictures
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.targets import Checkerboard

CAMERA = Camera(width_px=64, height_px=48, fx_px=60.0, fy_px=60.0, cx_px=31.5, cy_px=23.5)
BOARD = Checkerboard(cols=5, rows=4, square_mm=10.0)


def grey(level: int) -> Grey:
    return np.full((48, 64), level, np.uint8)


def test_damaged_files_are_named_and_others_of_another_size_refused(tmp_path: Path) -> None:
    good, cut, small = (tmp_path / name for name in ("good.png", "cut.png", "small.png"))
    write_image(good, grey(90))
    cut.write_bytes(good.read_bytes()[:-20])
    write_image(small, grey(90)[:30])
    taken = TakenPictures(CAMERA)
    read = list(taken.read([good, cut, grey(50)], mirrored=True))
    assert [None if picture is None else int(picture.mean()) for picture in read] == [90, None, 50]
    assert [str(error).startswith(f"{cut}: ") for error in taken.damaged] == [True]
    with pytest.raises(InputError, match="64x30 px, expected 64x48 of the layout's camera"):
        list(taken.read([small], mirrored=False))


def test_the_first_pictures_of_each_kind_are_looked_at_again(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = TakenPictures(CAMERA)
    list(taken.read([grey(10), grey(20), grey(30), grey(40)], mirrored=True))
    list(taken.read([grey(50)], mirrored=False))
    changes = taken.extremes.changes()
    assert changes is not None
    assert int(changes[0].max()) == 30  # those without mirrors do not count
    asked: list[tuple[list[int], bool, bool, bool]] = []

    def other(pictures: list[Grey], target: object, *, mirrored: bool, found: bool, fits: bool) -> str | None:
        asked.append(([int(picture.mean()) for picture in pictures], mirrored, found, fits))
        return "another board" if mirrored and not fits else None

    monkeypatch.setattr(taken_pictures, "other_board", other)
    taken.refuse_other_board(BOARD, seen=True, base=False, fits=True)
    assert asked == [([50], False, True, False), ([10, 20], True, True, True)]
    with pytest.raises(InputError, match="another board"):
        taken.refuse_other_board(BOARD, seen=False, base=True, fits=False)
