"""The thread of a live session that has mirrors compared with the layout, and boards found in calibration pictures."""

from __future__ import annotations

from collections import deque
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.studio.live.setup import (
    Aligning,
    AlignmentReport,
    PoseHint,
    add_picture,
    align_mirrors,
    open_setup,
)
from mirrorcam.studio.live.status import LiveMeters
from mirrorcam.studio.live.worker import LiveWorker


class SetupThread:
    """Keeps the newest report of the mirrors and the newest hint; pictures go before frames.

    Parameters
    ----------
    layout
        layout.json.
    board
        board.toml; None where no calibration pictures are taken.
    meters
        What is told where it fails.
    """

    def __init__(self, layout: Path, board: Path | None, meters: LiveMeters) -> None:
        self._layout, self._board = layout, board
        self._aligning, self._anew, self._switched = False, True, 0
        self._frames: tuple[NDArray[np.uint8], ...] = ()
        self._pictures: deque[Path] = deque()
        self._report: AlignmentReport | None = None
        self._hint: PoseHint | None = None
        self._worker = LiveWorker("setup", self._work, partial(meters.fail_part, "setup"))

    @property
    def report(self) -> AlignmentReport | None:
        """What the last frames tell of the mirrors; None before the first answer since that was switched on."""
        return self._report

    @property
    def aligning(self) -> Aligning:
        """Whether mirrors are compared with the layout."""
        with self._worker.changed:
            return "off" if not self._aligning else "measuring" if self._frames else "waiting"

    @property
    def hint(self) -> PoseHint | None:
        """What the last calibration picture showed."""
        return self._hint

    @property
    def wants_frames(self) -> bool:
        """Whether mirrors are to be compared in some of the last frames."""
        with self._worker.changed:
            return self._aligning and not self._frames

    def align(self, on: bool) -> None:
        """Compare the mirrors with the layout, again and again; switched on, from the start."""
        with self._worker.changed:
            self._aligning, self._anew, self._frames = on, True, ()
            if on:
                self._switched, self._report = self._switched + 1, None

    def give_frames(self, frames: tuple[NDArray[np.uint8], ...]) -> None:
        """Have mirrors compared in frames (h, w), grey."""
        with self._worker.changed:
            self._frames = frames
            self._worker.changed.notify_all()

    def give_picture(self, path: Path) -> None:
        """Have the board found in a calibration picture."""
        with self._worker.changed:
            self._pictures.append(path)
            self._worker.changed.notify_all()

    def start(self) -> None:
        """Begin."""
        self._worker.start()

    def close(self) -> None:
        """End it at once."""
        self._worker.close(at_once=True)

    def _work(self) -> None:
        process, changed, ending = self._worker.process, self._worker.changed, self._worker.ending
        process.call(open_setup, self._layout, self._board)
        while True:
            with changed:
                changed.wait_for(lambda: bool(self._pictures or self._frames) or ending.is_set())
                if ending.is_set():
                    return
                path = self._pictures.popleft() if self._pictures else None
                frames, anew, switched = self._frames, self._anew, self._switched
                if path is None:
                    self._anew = False
            if path is not None:
                self._hint = process.call(add_picture, path)
                continue
            report: AlignmentReport = process.call(align_mirrors, frames, anew)
            with changed:
                if self._switched == switched:
                    self._report, self._frames = report, ()
