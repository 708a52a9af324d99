"""Depth is measured in what was given last, while it is on and someone wants it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.studio.live.depth_thread import DepthThread
from mirrorcam.studio.live.pictures import LivePictures
from mirrorcam.studio.live.status import LiveMeters, LiveStatus
from mirrorcam.studio.live.values import Shown
from tests.studio.live.live_sets import frame, small

LONG_S, WIDTH_PX = 60.0, 80
FRAME = Shown(number=3, time_s=0.5, arrived_s=0.0, done_s=0.0, jpegs={})


def status(meters: LiveMeters) -> LiveStatus:
    return meters.status(alignment=None, hint=None, recording=None, calibration=None)


@pytest.fixture
def layout(tmp_path: Path, default_layout: Layout) -> Path:
    small(default_layout).save(tmp_path / "layout.json")
    return tmp_path / "layout.json"


@pytest.fixture
def samples(layout: Path) -> NDArray[np.uint8]:
    device = Layout.load(layout)
    return np.asarray(Decoder(device, width_px=WIDTH_PX).decode(frame(device, 420.0)).samples, np.uint8)


@pytest.fixture
def idle(layout: Path) -> Iterator[DepthThread]:
    """One that has not been started."""
    thread = DepthThread(layout, WIDTH_PX, LivePictures(None), LiveMeters())
    yield thread
    thread.close()


def test_depth_is_put_as_a_picture_and_counted(layout: Path, samples: NDArray[np.uint8]) -> None:
    pictures, meters = LivePictures(None), LiveMeters()
    thread = DepthThread(layout, WIDTH_PX, pictures, meters)
    thread.start()
    try:
        thread.give(replace(FRAME, arrived_s=time.monotonic()), samples)
        found = pictures.wait_for("depth", 0, LONG_S)
    finally:
        thread.close()
    assert found is not None and found.depth_mm is not None and (found.frame, found.time_s) == (3, 0.5)
    assert status(meters).depth_median_mm == pytest.approx(420.0, rel=0.02) and status(meters).lines == ()


def test_samples_are_wanted_unless_some_wait_or_it_is_off(idle: DepthThread, samples: NDArray[np.uint8]) -> None:
    assert idle.wants_samples
    idle.switch(False)
    assert not idle.wants_samples
    idle.switch(True)
    idle.give(FRAME, samples)
    assert not idle.wants_samples


def test_samples_that_nobody_looks_at_are_not_wanted(layout: Path) -> None:
    thread = DepthThread(layout, WIDTH_PX, LivePictures(0.1), LiveMeters())
    assert not thread.wants_samples
    thread.close()


def test_a_failure_is_said_and_does_not_end_the_session(tmp_path: Path) -> None:
    meters = LiveMeters()
    thread = DepthThread(tmp_path / "none.json", WIDTH_PX, LivePictures(None), meters)
    thread.start()
    end = time.monotonic() + LONG_S
    while not status(meters).lines:
        assert time.monotonic() < end
        time.sleep(0.01)
    thread.close()
    assert "none.json" in status(meters).lines[0] and not meters.ended
