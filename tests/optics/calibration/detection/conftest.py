"""Fixtures that several tests of detection share."""

from __future__ import annotations

import pytest

from tests.optics.calibration.detection.plate_frames import PlateFrames, rendered_frames


@pytest.fixture(scope="session")
def plate_frames(tmp_path_factory: pytest.TempPathFactory) -> PlateFrames:
    return rendered_frames(tmp_path_factory.mktemp("plates") / "set")
