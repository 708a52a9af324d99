"""The engine of `mirrorcam live`: frames, views, refocused pictures and depth of a camera, as a page shows them.

Nothing heavy runs in the process of the engine. One process decodes and encodes, one measures depth at its own rate,
and one aligns and finds boards; a thread of the engine stands by each.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, get_args

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.alignment.exposure_meter import Exposure
from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.base.worker_process import WorkerDied, WorkerProcess
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.workflow.live_calibration import CalibrationRun, CalibrationState
from mirrorcam.workflow.live_depth import DepthPicture, measure_depth, open_depth
from mirrorcam.workflow.live_session import close_session, next_pictures, open_session
from mirrorcam.workflow.live_setup import AlignmentReport, PoseHint, add_picture, align_mirrors, open_setup
from mirrorcam.workflow.live_values import DECODED, Answer, LiveRequest, Orders, PictureKind, SessionAbout, Shown

REMEMBERED = 120
"""Frames over which rates and latencies are measured."""
RECENT_S = 3.0
OUTLINE_POINTS = 8
"""Points of an edge of an outline."""


@dataclass(frozen=True, eq=False)
class LivePicture:
    """A JPEG picture of a frame, counted from 1 in its kind.

    `depth_mm` (v, u) is beside a picture of depth, 0 where it is not known.
    """

    serial: int
    frame: int
    time_s: float
    jpeg: bytes
    depth_mm: NDArray[np.uint16] | None = None


@dataclass(frozen=True)
class LiveStatus:
    """How a session goes.

    Attributes
    ----------
    frames
        Number of frames shown.
    rate_hz, depth_hz
        Pictures in a second, in the last RECENT_S.
    latency_ms, latency_p95_ms
        From the arrival of a frame to its encoded pictures: median, and of 19 in 20. None before the first frame.
    depth_latency_ms
        The same of depth, its median.
    dropped, lost, outages
        Frames left out as newer ones had arrived, frames that could not be read, and how often the camera was gone.
    over
        Whether the source has ended.
    memory_mb
        Memory of the process that decodes.
    sharpness
        Of each mirror, relative to its best so far; NaN where it cannot be told.
    exposure
        Exposure.
    alignment
        What the last frames tell of the mirrors.
    hint
        What the last calibration picture showed, and where the board should be in the next one.
    pictures
        Number of calibration pictures taken.
    recording
        The file that frames go to, and their number.
    calibration
        How far the calibration is.
    depth_median_mm
        Depth in the middle of the picture.
    lines
        The last messages.
    failed
        Why the session has ended before its source; None where it has not.
    """

    frames: int
    rate_hz: float
    depth_hz: float
    latency_ms: float | None
    latency_p95_ms: float | None
    depth_latency_ms: float | None
    dropped: int
    lost: int
    outages: int
    over: bool
    memory_mb: float
    sharpness: tuple[float, ...]
    exposure: Exposure | None
    alignment: AlignmentReport | None
    hint: PoseHint | None
    pictures: int
    recording: tuple[Path, int] | None
    calibration: CalibrationState | None
    depth_median_mm: float | None
    lines: tuple[str, ...]
    failed: str | None


class LiveEngine:
    """A live session. Use it in a `with` block, or `close` it.

    Parameters
    ----------
    request
        What is shown.
    out
        Folder for recordings, calibration pictures and calibrations.
    board
        board.toml, to take calibration pictures.
    idle_s
        Time after which pictures of a kind that `wait_for` was not asked for are no longer made; by default they always
        are.

    Attributes
    ----------
    about : SessionAbout
        What is shown.

    Raises
    ------
    InputError
        Where the layout, the board or the source cannot be opened.
    """

    def __init__(
        self,
        request: LiveRequest,
        *,
        out: Path = Path("output/live"),
        board: Path | None = None,
        idle_s: float | None = None,
    ) -> None:
        self.request, self.out, self.board = request, out, board
        self._idle_s, self._asked = idle_s, dict.fromkeys(get_args(PictureKind), -np.inf)
        self._decoding, self._depth, self._setup = WorkerProcess(), WorkerProcess(), WorkerProcess()
        self._changed, self._ending = threading.Condition(), threading.Event()
        self._orders = Orders()
        self._show_depth, self._aligning, self._anew = True, False, True
        self._latest: dict[PictureKind, LivePicture] = {}
        self._depth_input: tuple[Shown, NDArray[np.uint8]] | None = None
        self._frames: tuple[NDArray[np.uint8], ...] = ()
        self._to_find: deque[Path] = deque()
        self._arrivals: deque[float] = deque(maxlen=REMEMBERED)
        self._latencies: deque[float] = deque(maxlen=REMEMBERED)
        self._depths: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)
        self._answer: Answer | None = None
        self._shown = self._taken = 0
        self._sharpness: tuple[float, ...] = ()
        self._exposure: Exposure | None = None
        self._alignment: AlignmentReport | None = None
        self._hint: PoseHint | None = None
        self._depth_median_mm: float | None = None
        self._lines: deque[str] = deque(maxlen=50)
        self._failed: str | None = None
        self._calibration: CalibrationRun | None = None
        try:
            self.about: SessionAbout = self._decoding.call(open_session, request)
        except BaseException:
            self._kill()
            raise
        loops = ((self._decode, "decoding"), (self._measure, "depth"), (self._set_up, "setup"))
        self._threads = [
            threading.Thread(target=self._run, args=loop, name=f"live {loop[1]}", daemon=True) for loop in loops
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Finish the recording and end all processes."""
        if self._ending.is_set():
            return
        self._ending.set()
        with self._changed:
            self._changed.notify_all()
        self._depth.kill()
        self._setup.kill()
        for thread in self._threads:
            thread.join(5.0)
        if self._calibration is not None:
            self._calibration.cancel()
        self._kill()

    def outlines_px(self) -> dict[str, list[list[float]]]:
        """Outline (n, 2) of each mirror's sub-image as designed, in pixels of the camera, by the mirror's name."""
        layout = Layout.load(self.request.layout)
        found = {}
        for k, name in enumerate(layout.mirror_names):
            outline = layout.outline_px(k, points_per_edge=OUTLINE_POINTS, usable=True)
            found[name] = outline[np.isfinite(outline).all(axis=1)].round(1).tolist()
        return found

    def latest(self, kind: PictureKind) -> LivePicture | None:
        """The newest picture of a kind; None before the first."""
        with self._changed:
            return self._latest.get(kind)

    def wait_for(self, kind: PictureKind, after: int, timeout_s: float) -> LivePicture | None:
        """The newest picture of a kind whose serial number is beyond `after`; None where there is none in time."""

        def newer() -> bool:
            picture = self._latest.get(kind)
            return (picture is not None and picture.serial > after) or self._ending.is_set()

        with self._changed:
            self._asked[kind] = time.monotonic() + timeout_s
            self._changed.wait_for(newer, timeout_s)
            self._asked[kind] = time.monotonic()
            picture = self._latest.get(kind)
            return picture if picture is not None and picture.serial > after else None

    def focus(self, depth_mm: float) -> None:
        """Refocus at a depth from the next frame on. Raises InputError for one not beyond the views."""
        if not depth_mm > self.about.least_focus_mm:
            least = f"more than {self.about.least_focus_mm:.0f} mm"
            raise InputError(f"focus at {depth_mm:g} mm, expected a depth beyond the views, {least}")
        self._order(focus_mm=depth_mm)

    def show(self, kinds: tuple[PictureKind, ...]) -> None:
        """Make pictures of these kinds only."""
        self._order(kinds=tuple(kind for kind in kinds if kind in DECODED))
        with self._changed:
            self._show_depth = "depth" in kinds
            self._changed.notify_all()

    def align(self, on: bool) -> None:
        """Compare the mirrors with the layout, again and again; switched on, from the start."""
        with self._changed:
            self._aligning, self._anew, self._frames = on, True, ()
            self._changed.notify_all()

    def reset_focus_meter(self) -> None:
        """Forget how sharp sub-images have been."""
        self._order(reset_focus=True)

    def record(self) -> Path:
        """Write frames to a new video from the next one on, and return its path.

        Raises InputError where the source has ended.
        """
        self._refuse_ended()
        path = self._free(self.out / "recordings", "recording", ".mkv")
        self._order(record=path)
        return path

    def stop_recording(self) -> None:
        """Finish the video."""
        self._order(record=None)

    def take_picture(self) -> Path:
        """Write the next frame as a calibration picture, without loss, and return its path; `status` has the hint.

        Raises InputError without a board, and where the source has ended.
        """
        self._refuse_ended()
        if self.board is None:
            raise InputError("no board is stated, expected --board board.toml to take calibration pictures")
        with self._changed:
            path = self._orders.take or self._free(self.out / "pictures", "picture", ".png")
            self._orders = replace(self._orders, take=path)
        return path

    def calibrate(self) -> Path:
        """Calibrate from the pictures taken, in a process of its own; returns the folder that the result will be in.

        Raises InputError without pictures, or while another calibration runs.
        """
        if self.board is None:
            raise InputError("no board is stated, expected --board board.toml to calibrate")
        pictures = self.out / "pictures"
        if not any(pictures.glob("picture_*.png")):
            raise InputError(f"{pictures}: holds no picture, expected calibration pictures to be taken first")
        if self._calibration is not None and self._calibration.state().state == "running":
            raise InputError("a calibration runs already, expected it to end first")
        out = self._free(self.out / "calibrations", "calibration", "")
        self._calibration = CalibrationRun(pictures, self.board, self.request.layout, out)
        return out

    def status(self) -> LiveStatus:
        """How the session goes."""
        now = time.monotonic()
        with self._changed:
            answer, latencies, record = self._answer, sorted(self._latencies), self._orders.record
            depths = [(done, latency) for done, latency in self._depths if now - done < RECENT_S]
            calibration = None if self._calibration is None else self._calibration.state()
            return LiveStatus(
                frames=self._shown,
                rate_hz=_rate([each for each in self._arrivals if now - each < RECENT_S]),
                depth_hz=_rate([done for done, _ in depths]),
                latency_ms=_quantile(latencies, 0.5),
                latency_p95_ms=_quantile(latencies, 0.95),
                depth_latency_ms=_quantile(sorted(latency for _, latency in depths), 0.5),
                dropped=0 if answer is None else answer.dropped,
                lost=0 if answer is None else answer.lost,
                outages=0 if answer is None else answer.outages,
                over=answer is not None and answer.over,
                memory_mb=0.0 if answer is None else answer.memory_mb,
                sharpness=self._sharpness,
                exposure=self._exposure,
                alignment=self._alignment,
                hint=self._hint,
                pictures=self._taken,
                recording=None if record is None else (record, 0 if answer is None else answer.recorded),
                calibration=calibration,
                depth_median_mm=self._depth_median_mm,
                lines=tuple(self._lines),
                failed=self._failed,
            )

    def _is_wanted(self, kind: PictureKind) -> bool:
        """Whether someone was waiting for pictures of a kind lately."""
        return self._idle_s is None or time.monotonic() - self._asked[kind] < self._idle_s

    def _refuse_ended(self) -> None:
        with self._changed:
            if self._failed is not None or (self._answer is not None and self._answer.over):
                raise InputError(f"{self.about.source} has ended, expected a source that gives more frames")

    def _order(self, **changes: Any) -> None:
        with self._changed:
            self._orders = replace(self._orders, **changes)

    def _free(self, folder: Path, stem: str, suffix: str) -> Path:
        """The first name in a folder that nothing has."""
        number = 1
        while (path := folder / f"{stem}_{number:04d}{suffix}").exists():
            number += 1
        return path

    def _kill(self) -> None:
        for worker in (self._decoding, self._depth, self._setup):
            worker.kill()

    def _run(self, loop: Callable[[], None], what: str) -> None:
        """Run a loop; where it fails, the status says why."""
        try:
            loop()
        except (InputError, RuntimeError, WorkerDied) as error:
            if self._ending.is_set():
                return
            reason = f"the process for {what} has ended {error}" if isinstance(error, WorkerDied) else str(error)
            with self._changed:
                self._lines.append(reason)
                if what == "decoding":
                    self._failed = reason
                self._changed.notify_all()

    def _decode(self) -> None:
        while not self._ending.is_set():
            with self._changed:
                orders = replace(
                    self._orders,
                    kinds=tuple(kind for kind in self._orders.kinds if self._is_wanted(kind)),
                    depth=self._show_depth and self._is_wanted("depth") and self._depth_input is None,
                    frames=self._aligning and not self._frames,
                )
            try:
                answer: Answer = self._decoding.call(next_pictures, orders)
            except InputError as error:
                if orders.take is None and orders.record is None:
                    raise
                # A file that cannot be written ends what it was for, not the session.
                with self._changed:
                    self._lines.append(str(error))
                    self._orders = replace(self._orders, take=None, record=None)
                continue
            self._note(answer, orders)
            if answer.over:
                with self._changed:
                    self._changed.wait_for(self._ending.is_set, timeout=0.2)
        try:
            self._decoding.call(close_session)
        except (InputError, RuntimeError, WorkerDied) as error:
            self._lines.append(str(error))

    def _note(self, answer: Answer, orders: Orders) -> None:
        shown = answer.shown
        with self._changed:
            self._answer = answer
            self._lines.extend(answer.lines)
            if orders.reset_focus:
                self._orders = replace(self._orders, reset_focus=False)
            if shown is None:
                return
            self._shown += 1
            self._arrivals.append(shown.done_s)
            self._latencies.append(1e3 * (shown.done_s - shown.arrived_s))
            for kind, jpeg in shown.jpegs.items():
                self._put(kind, shown, jpeg)
            self._sharpness = self._sharpness if shown.sharpness is None else shown.sharpness
            self._exposure = self._exposure if shown.exposure is None else shown.exposure
            if shown.samples is not None:
                self._depth_input = (replace(shown, jpegs={}, frames=()), shown.samples)
            self._frames = shown.frames or self._frames
            if shown.taken is not None:
                self._taken += 1
                self._to_find.append(shown.taken)
                if self._orders.take == shown.taken:
                    self._orders = replace(self._orders, take=None)
            self._changed.notify_all()

    def _put(self, kind: PictureKind, shown: Shown, jpeg: bytes, depth_mm: NDArray[np.uint16] | None = None) -> None:
        before = self._latest.get(kind)
        serial = 1 if before is None else before.serial + 1
        self._latest[kind] = LivePicture(serial, shown.number, shown.time_s, jpeg, depth_mm)

    def _measure(self) -> None:
        self._depth.call(open_depth, self.request.layout, self.request.depth_width_px)
        while not self._ending.is_set():
            with self._changed:
                self._changed.wait_for(lambda: self._depth_input is not None or self._ending.is_set())
                if self._ending.is_set() or self._depth_input is None:
                    return
                shown, samples = self._depth_input
                self._depth_input = None
            found: DepthPicture = self._depth.call(measure_depth, samples)
            done = time.monotonic()
            with self._changed:
                self._depths.append((done, 1e3 * (done - shown.arrived_s)))
                self._depth_median_mm = found.median_mm if np.isfinite(found.median_mm) else None
                self._put("depth", shown, found.jpeg, found.depth_mm)
                self._changed.notify_all()

    def _set_up(self) -> None:
        self._setup.call(open_setup, self.request.layout, self.board)
        while not self._ending.is_set():
            with self._changed:
                self._changed.wait_for(lambda: bool(self._to_find or self._frames) or self._ending.is_set())
                if self._ending.is_set():
                    return
                path = self._to_find.popleft() if self._to_find else None
                frames, anew = self._frames, self._anew
                if path is None:
                    self._anew = False
            if path is not None:
                hint: PoseHint = self._setup.call(add_picture, path)
                with self._changed:
                    self._hint = hint
                    self._changed.notify_all()
                continue
            report: AlignmentReport = self._setup.call(align_mirrors, frames, anew)
            with self._changed:
                self._frames = ()
                self._alignment = report
                self._changed.notify_all()


def _rate(moments: list[float]) -> float:
    """Events in a second."""
    return (len(moments) - 1) / (moments[-1] - moments[0]) if len(moments) > 1 and moments[-1] > moments[0] else 0.0


def _quantile(ordered: list[float], part: float) -> float | None:
    return ordered[min(int(part * len(ordered)), len(ordered) - 1)] if ordered else None
