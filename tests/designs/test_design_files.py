"""A design as files: what lies in the folder, with a parabola and without one."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.designs.design_files import write_design
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout


def test_files_hold_what_is_returned(default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = DesignSpec()
    figures = {"metrics": evaluate(default_layout, spec.depths_mm), "verdict": verify(default_layout, spec)}
    layout = default_layout.replaced(spec=spec, **figures)
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls: layout)
    found = write_design(spec, tmp_path)
    assert found.no_parabola == ""
    assert Layout.load(tmp_path / "layout.json") == found.optimised == layout
    assert Layout.load(tmp_path / "parabola.json") == found.parabola
    assert found.parabola is not None
    assert found.parabola.metrics.keys() == layout.metrics.keys()

    def refuse(spec: DesignSpec) -> Layout:
        raise InfeasibleDesign("spacing", "facets do not fit")

    monkeypatch.setattr("mirrorcam.optics.design.optimise.faceted_parabola", refuse)
    found = write_design(spec, tmp_path / "without")
    assert found.parabola is None
    assert "facets do not fit" in found.no_parabola
    written = sorted(path.name for path in (tmp_path / "without").iterdir())
    assert written == ["before_after.png", "focus.png", "layout.json"]


def test_the_layout_is_there_before_any_picture_of_it(
    default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = default_layout.replaced(spec=DesignSpec())
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls: layout)

    def broken(*_: object) -> None:
        raise FloatingPointError("no picture")

    monkeypatch.setattr("mirrorcam.designs.design_files.before_after", broken)
    with pytest.raises(FloatingPointError):
        write_design(DesignSpec(), tmp_path)
    assert Layout.load(tmp_path / "layout.json") == layout
    assert (tmp_path / "parabola.json").exists()


def test_a_pinhole_has_no_figure_of_its_focus(
    default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = DesignSpec(camera=default_layout.camera.replaced(aperture_mm=0.0))
    layout = default_layout.replaced(spec=spec, camera=spec.camera)
    monkeypatch.setattr("mirrorcam.optics.design.optimise.design", lambda spec, calls: layout)
    write_design(spec, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["before_after.png", "layout.json", "parabola.json"]
