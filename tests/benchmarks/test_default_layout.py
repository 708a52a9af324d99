"""Figures of the default design: by hand, and those that the documents have."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import default_layout as benchmark
from benchmarks.records import Records
from docs.make_measured import MEASURED
from mirrorcam.optics.geometry.layout import Layout


def test_widths_are_those_of_the_edges_nearest_and_farthest(default_layout: Layout) -> None:
    camera = default_layout.camera.replaced(aperture_mm=2.0, focus_mm=1000.0)
    depths = np.concatenate([mirror.outline_in_rig_mm[:, 2] for mirror in default_layout.mirrors])
    widths = (camera.fx_px / depths.max() - camera.fx_px / 1000.0, camera.fx_px / depths.min() - camera.fx_px / 1000.0)
    assert benchmark.faded_px(default_layout.replaced(camera=camera)) == pytest.approx(widths)


def test_the_documents_have_the_figures_of_the_design(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["default_layout", "--json", str(tmp_path / "new.json")])
    benchmark.main()
    new, held = (Records.load(path).records["default_layout"].values for path in (tmp_path / "new.json", MEASURED))
    assert {name: each.value for name, each in held.items()} == pytest.approx(
        {name: each.value for name, each in new.items()}, abs=1e-6
    )
