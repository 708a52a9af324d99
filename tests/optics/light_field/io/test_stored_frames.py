"""Stored frames as a sequence: a list's indices, of which only those that are asked for are read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mirrorcam.optics.light_field.io.stored_frames import StoredFrames
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.depth.surfaces import Surface, grid_views, photograph

COUNT = 5


class Frames(StoredFrames):
    """Frames whose identity is their number, and the numbers of those that were read."""

    def __init__(self, frame: LightField) -> None:
        self.path, self.read = Path("recording.zarr"), list[int]()
        self._one = frame

    def __len__(self) -> int:
        return COUNT

    def _frame(self, number: int) -> LightField:
        self.read.append(number)
        return replace(self._one, layout_identity=str(number))


@pytest.fixture
def frames() -> Frames:
    return Frames(photograph(grid_views(width_px=12, height_px=9), [Surface(500.0)])[0])


def test_indices_are_those_of_a_list_and_nothing_else_is_read(frames: Frames) -> None:
    numbers = list(range(COUNT))
    for index in (0, 3, COUNT - 1, -1, -COUNT):
        assert frames[index].layout_identity == str(numbers[index])
    assert frames.read == [0, 3, 4, 4, 0]
    for part in (slice(1, 3), slice(None, None, -2), slice(-2, None), slice(3, 99), slice(4, 1)):
        frames.read.clear()
        assert [each.layout_identity for each in frames[part]] == [str(number) for number in numbers[part]]
        assert frames.read == numbers[part]


def test_frames_can_be_iterated(frames: Frames) -> None:
    assert [each.layout_identity for each in frames] == ["0", "1", "2", "3", "4"]
    assert [each.layout_identity for each in reversed(frames)] == ["4", "3", "2", "1", "0"]


@pytest.mark.parametrize("index", [COUNT, -COUNT - 1])
def test_other_indices_are_refused(frames: Frames, index: int) -> None:
    with pytest.raises(IndexError, match=rf"recording\.zarr: frame {index}, expected one of {COUNT}"):
        frames[index]
    assert not frames.read
