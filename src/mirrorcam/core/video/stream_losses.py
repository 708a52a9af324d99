"""Describe frames of a video or a camera that could not be used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.video.live_camera import LiveCamera
from mirrorcam.core.video.video_files import VideoFile

Stream = VideoFile | LiveCamera


def expected_frames(source: Stream, limit: int | None) -> int | None:
    """Return the expected number of frames of a stream; None if unknown."""
    count = None if isinstance(source, LiveCamera) else source.count
    return limit if count is None or (limit or count) < count else count


def sources_text(source: Stream) -> str:
    """Return the arguments of `mirrorcam drift` for a stream."""
    return "FRAMES" if isinstance(source, LiveCamera) else str(source.path)


def losses(source: Stream, used: int, lost: Mapping[int, str], expected: int | None) -> list[str]:
    """Return a line per reason for unused frames, and one if the file ends early.

    For a camera, also report dropped frames and outages.
    """
    total = used + len(lost)
    lines = []
    for reason in dict.fromkeys(lost.values()):
        numbers = sorted(number for number, cause in lost.items() if cause == reason)
        lines.append(f"skipped {len(numbers)} of {total} frames, each {reason}: {spans(numbers)}")
    if isinstance(source, LiveCamera):
        if source.dropped:
            lines.append(f"left out {source.dropped} of {total + source.dropped} frames, which came too fast to decode")
        if source.outages:
            lines.append(f"the camera disconnected {count_text(source.outages, 'time')}")
    elif expected is not None and total < expected:
        lines.append(f"ends after {total} of {expected} frames; the file is cut off")
    return lines


def spans(numbers: Sequence[int]) -> str:
    """Return ascending numbers as text, with consecutive ones joined: 3, 7 to 12."""
    runs = [[number for _, number in run] for _, run in groupby(enumerate(numbers), key=lambda item: item[1] - item[0])]
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
