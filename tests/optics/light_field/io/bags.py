"""Bags for tests, which are skipped if the extra robot is not installed."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam.optics.light_field.depth.depth_map import DepthMap
from mirrorcam.optics.light_field.io.bag_writer import BagWriter
from mirrorcam.optics.light_field.io.ros_messages import frame_messages, latched_messages
from mirrorcam.optics.light_field.light_field import LightField

HAS_ROSBAGS = find_spec("rosbags") is not None
needs_rosbags = pytest.mark.skipif(not HAS_ROSBAGS, reason="needs rosbags, of the extra robot")
STEP_NS = 40_000_000


def write_bag(path: Path, light_fields: list[LightField], depth: DepthMap | None = None) -> Path:
    """Write a bag of light fields 40 ms apart, from 1 s on."""
    with BagWriter(path) as bag:
        for number, light_field in enumerate(light_fields):
            stamp = 10**9 + number * STEP_NS
            before = latched_messages(light_field, stamp) if number == 0 else ()
            bag.write([*before, *frame_messages(light_field, stamp, depth)], stamp)
    return path
