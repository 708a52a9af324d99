"""The thread of a live session that has depth measured, at the rate of the process that measures it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.studio.live.depth import DepthPicture, measure_depth, open_depth
from mirrorcam.studio.live.pictures import LivePictures
from mirrorcam.studio.live.status import LiveMeters
from mirrorcam.studio.live.values import Shown
from mirrorcam.studio.live.worker import LiveWorker


class DepthThread:
    """Puts pictures of depth; what is given while it works replaces what waits.

    Parameters
    ----------
    layout
        layout.json.
    width_px
        Width of the views that depth is measured in.
    pictures, meters
        Where pictures go, and what counts them.
    """

    def __init__(self, layout: Path, width_px: int, pictures: LivePictures, meters: LiveMeters) -> None:
        self._layout, self._width_px = layout, width_px
        self._pictures, self._meters = pictures, meters
        self._on = True
        self._input: tuple[Shown, NDArray[np.uint8]] | None = None
        self._worker = LiveWorker("depth", self._measure, partial(meters.fail_part, "depth"))

    @property
    def wants_samples(self) -> bool:
        """Whether samples of the next frame would be measured."""
        with self._worker.changed:
            return self._on and self._input is None and self._pictures.wanted("depth")

    def switch(self, on: bool) -> None:
        """Measure depth, or do not: what waits is then dropped, and what is being measured is not shown."""
        with self._worker.changed:
            self._on = on
            if not on:
                self._input = None

    def give(self, shown: Shown, samples: NDArray[np.uint8]) -> None:
        """Have depth measured in the samples (t, s, v, u, 3) of a frame next."""
        with self._worker.changed:
            self._input = (shown, samples)
            self._worker.changed.notify_all()

    def start(self) -> None:
        """Begin."""
        self._worker.start()

    def close(self) -> None:
        """End it at once."""
        self._worker.close(at_once=True)

    def _measure(self) -> None:
        process = self._worker.process
        process.call(open_depth, self._layout, self._width_px)
        while (given := self._next()) is not None:
            shown, samples = given
            found: DepthPicture = process.call(measure_depth, samples)
            with self._worker.changed:
                if self._on:
                    self._meters.note_depth(shown, found.median_mm)
                    self._pictures.put("depth", shown, found.jpeg, found.depth_mm)

    def _next(self) -> tuple[Shown, NDArray[np.uint8]] | None:
        """What was given last, once there is something; None where no more is wanted."""
        with self._worker.changed:
            self._worker.changed.wait_for(lambda: self._input is not None or self._worker.ending.is_set())
            given, self._input = self._input, None
            return None if self._worker.ending.is_set() else given
