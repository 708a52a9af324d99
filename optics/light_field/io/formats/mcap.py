"""ROS 2 bags, written by `mirrorcam decode --to mcap`: read frame by frame, written with one frame at time 0."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.optics.light_field.io.bag_reader import StoredBag
from mirrorcam.optics.light_field.io.bag_writer import BagWriter
from mirrorcam.optics.light_field.io.light_field_format import Contents, Format, without_depth
from mirrorcam.optics.light_field.io.ros_messages import frame_messages, latched_messages
from mirrorcam.optics.light_field.light_field import LightField


def is_bag(path: Path) -> bool:
    """Return whether a path is named as an MCAP file, or is a rosbag2 folder."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix.lower() == ".mcap"


def write_bag(path: Path, light_field: LightField) -> None:
    """Write one light field as a bag with one frame."""
    with BagWriter(path) as bag:
        bag.write([*latched_messages(light_field, 0), *frame_messages(light_field, 0)], 0)


def _contents(bag: StoredBag) -> Contents:
    return Contents(bag, is_recording=True, times_s=[stamp / 1e9 for stamp in bag.stamps_ns])


FORMAT = Format(
    name="mcap",
    ending=".mcap",
    detect=is_bag,
    read=lambda path, assumed: _contents(StoredBag(path)),
    write=without_depth(write_bag),
)
