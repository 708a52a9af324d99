"""The pictures of a calibration as they are read: which are damaged, and what is kept of the others."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import agree_on_bits, check_size, read_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.other_boards import MOST_PICTURES, other_board
from mirrorcam.optics.calibration.detection.segmentation import Extremes
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.targets import Target

MOST_KEPT = 24  # arrays of an iterator, so that memory stays flat


def checked_pictures(name: str, pictures: Iterable[Grey | AnyPath]) -> Iterable[Grey | Path]:
    """Pictures with paths as `Path`; a sequence stays one. Raises TypeError for what is no iterable of them.

    Raises InputError for an array of anything but grey values.
    """
    if isinstance(pictures, str | os.PathLike | np.ndarray) or not isinstance(pictures, Iterable):
        raise TypeError(f"{name}: {type(pictures).__name__}, expected an iterable of arrays or paths")

    def checked(picture: Grey | AnyPath) -> Grey | Path:
        if not isinstance(picture, np.ndarray):
            return path_of(name, picture)
        if picture.dtype != np.uint8 or picture.ndim != 2:
            raise InputError(
                f"{name}: an array {picture.shape} of {picture.dtype}, expected (h, w) of uint8, grey values"
            )
        return picture

    return [checked(each) for each in pictures] if isinstance(pictures, Sequence) else map(checked, pictures)


class TakenPictures:
    """Pictures that are read one at a time: those that are damaged, the first ones, and the extremes of those mirrored.

    Attributes
    ----------
    damaged
        What is wrong with each damaged file so far.
    extremes
        Extremes of the pictures through the mirrors so far.
    mirrored
        The pictures through the mirrors so far; None for a damaged one, and for an array that only an iterator holds
        once `MOST_KEPT` of them are kept.
    """

    def __init__(self, camera: Camera) -> None:
        self.damaged: list[DamagedPicture] = []
        self.extremes = Extremes()
        self.mirrored: list[Grey | Path | None] = []
        self._arrays = 0
        self._camera = camera
        self._first: dict[bool, list[Grey]] = {True: [], False: []}

    def read(self, pictures: Iterable[Grey | Path], *, mirrored: bool) -> Iterator[Grey | None]:
        """Return the grey values of pictures, None for each file that is damaged.

        Raises InputError for a file of another size than the camera's.
        """
        held = isinstance(pictures, Sequence)
        if held:
            agree_on_bits([each for each in pictures if isinstance(each, Path)])
        for picture in pictures:
            grey = self._grey(picture)
            yield grey
            # Once the next one is requested, this one was found to have the expected size.
            if mirrored:
                keep = held or isinstance(picture, Path) or self._arrays < MOST_KEPT
                self._arrays += not isinstance(picture, Path)
                self.mirrored.append(picture if grey is not None and keep else None)
            if grey is None:
                continue
            if mirrored:
                self.extremes.add(grey)
            if len(self._first[mirrored]) < MOST_PICTURES:
                self._first[mirrored].append(grey)

    def first(self, *, mirrored: bool) -> Sequence[Grey]:
        """The first pictures, up to `MOST_PICTURES`, through the mirrors or without them."""
        return self._first[mirrored]

    def refuse_other_board(self, target: Target, *, seen: bool, base: bool, fits: bool) -> None:
        """Raise InputError where the first pictures show another board than the stated one.

        `seen` and `base` are whether that was found in any picture through the mirrors, and without them, and `fits`
        whether what was found fits as far as is known.
        """
        for mirrored, found in ((False, base), (True, seen)):
            other = other_board(
                self._first[mirrored], target, mirrored=mirrored, found=seen or base, fits=fits and found
            )
            if other is not None:
                raise InputError(other)

    def _grey(self, picture: Grey | Path) -> Grey | None:
        if not isinstance(picture, Path):
            return picture
        try:
            grey = read_image(picture, grey=True)
        except DamagedPicture as error:
            self.damaged.append(error)
            return None
        size = (self._camera.width_px, self._camera.height_px)
        check_size(picture, (grey.shape[1], grey.shape[0]), size, "the layout's camera")
        return grey
