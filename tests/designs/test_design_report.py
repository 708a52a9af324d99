"""The report of a design: one file with its figures, checks, pictures and request."""

from __future__ import annotations

import base64
import re

import pytest

from mirrorcam.core.values import Metric
from mirrorcam.designs.design_report import ReportPicture, design_pictures, design_report
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.monte_carlo import study
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances

SPEC = DesignSpec()


@pytest.fixture(scope="module")
def layout(default_layout: Layout) -> Layout:
    figures = {"metrics": evaluate(default_layout, SPEC.depths_mm), "verdict": verify(default_layout, SPEC)}
    return default_layout.replaced(spec=SPEC, **figures)


def test_it_holds_everything_in_itself(layout: Layout) -> None:
    page = design_report(layout, None, [ReportPicture("Sensor", "a picture", "QUJD")])
    assert layout.identity in page
    assert "All 14 checks pass" in page
    assert 'src="data:image/png;base64,QUJD" alt="a picture"' in page
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)
    assert "scale_mm" in page


def test_a_failed_check_is_reported_at_the_top(layout: Layout) -> None:
    gap = layout.verdict["smallest_gap_mm"].replaced(value=0.1)
    failed = layout.replaced(verdict=layout.verdict | {"smallest_gap_mm": gap})
    assert "1 of 14 checks failed" in design_report(failed, None, [])


def test_a_figure_that_is_none_says_why(layout: Layout) -> None:
    why = "the views are <blurred>"
    none = Metric(value=float("nan"), unit="mm", reason=why)
    page = design_report(layout.replaced(metrics=layout.metrics | {"depth_sigma_300mm": none}), None, [])
    assert page.count("the views are &lt;blurred&gt;") == 2  # a tile, and the table
    assert "none: the views are" in page
    assert "Devices as built" not in page
    assert "None: no device can be built." in design_report(layout, None, [], not_built="no device can be built")


@pytest.mark.parametrize("depth", ["12", "300", "0.5", "1e+06"])
def test_a_headline_names_its_depth(depth: str, layout: Layout) -> None:
    usable = Metric(value=0.25, unit="of the sensor")
    page = design_report(layout.replaced(metrics={f"usable_efficiency_{depth}mm": usable}), None, [])
    assert f"is usable at {depth} mm" in page


def test_names_are_escaped(layout: Layout) -> None:
    camera = layout.camera.replaced(name="<script>alert(1)</script>")
    named = layout.replaced(camera=camera, spec=SPEC.replaced(camera=camera))
    assert "<script>alert" not in design_report(named, None, [])


@pytest.mark.slow
def test_each_thing_has_its_picture(default_layout: Layout) -> None:
    layout = default_layout.replaced(spec=DesignSpec())
    built = study(layout, Tolerances.hobby(), (300.0, 500.0), devices=4)
    pictures = design_pictures(layout, None, built)
    assert [picture.title for picture in pictures] == ["Sensor, mirrors and coverage", "Focus", "Devices as built"]
    contents = [base64.b64decode(picture.base64) for picture in pictures]
    assert all(content.startswith(b"\x89PNG") and content.endswith(b"IEND\xaeB`\x82") for content in contents)
    assert len(set(contents)) == 3
    pinhole = layout.replaced(camera=layout.camera.replaced(aperture_mm=0.0))
    assert [picture.title for picture in design_pictures(pinhole, None)] == ["Sensor, mirrors and coverage"]
