"""A trajectory of light fields: times of a recording, or of a rate."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs, NamedLightField
from mirrorcam.lightfield.tracking import TrackSearch, write_trajectory
from tests.optics.light_field.relief_scene import Relief, even_views, light_field_of

SIZE: dict[str, Any] = {"width_px": 160, "height_px": 120, "focal_px": 280.0, "centre_px": np.array([79.5, 59.5])}


@pytest.mark.parametrize(("times_s", "expected"), [((5.0, 5.2), [5.0, 5.2]), ((None, None), [0.0, 0.5])])
def test_times_are_those_of_the_file_or_of_the_rate(
    times_s: tuple[float | None, ...], expected: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    light_field = light_field_of(Relief(), even_views(3, 10.0, **SIZE), subsamples=1)[0]

    def each(self: LightFieldInputs, progress: Progress = no_progress) -> Iterator[NamedLightField]:
        for number, time_s in enumerate(times_s):
            yield NamedLightField(f"clip_{number}", light_field, None, time_s)

    monkeypatch.setattr(LightFieldInputs, "each", each)
    found = write_trajectory(LightFieldInputs((Path("clip.zarr"),)), tmp_path, TrackSearch(rate_hz=2.0))
    assert found.times_s == expected
    assert found.path_mm < 0.05
    assert np.allclose(np.loadtxt(tmp_path / "trajectory.tum")[:, 0], expected)
