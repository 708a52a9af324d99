"""Files with pictures of a camera over time: videos, and ROS 2 bags."""

from __future__ import annotations

from collections.abc import Callable

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.video.camera_bag import CameraBag, bag_and_topic
from mirrorcam.core.video.video import Video

VideoFile = Video | CameraBag


def open_video(path: AnyPath, on_note: Callable[[str], None] | None = None) -> VideoFile:
    """Open a video, or the pictures of a camera in a ROS 2 bag, whose frames are RGB.

    Parameters
    ----------
    path
        A video; an MCAP file or a folder of `ros2 bag record`; or BAG:/TOPIC for one of several cameras in a bag.
    on_note
        Called with remarks on a video for the user: it is interlaced, or players rotate it.

    Returns
    -------
    Video or CameraBag
        The file, whose `frames` are read on demand.

    Raises
    ------
    InputError
        If the file cannot be read, or contains no pictures of one camera.
    """
    return Video(path, on_note) if bag_and_topic(path_of("path", path)) is None else CameraBag(path)
