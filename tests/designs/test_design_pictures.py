"""The pictures of a design's report are whole pictures, one for each thing that can be shown."""

from __future__ import annotations

import base64

import pytest

from mirrorcam.designs.design_pictures import design_pictures
from mirrorcam.optics.design.assess.monte_carlo import study
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances


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


def test_a_layout_without_a_request_has_none(default_layout: Layout) -> None:
    with pytest.raises(ValueError, match="without a spec"):
        design_pictures(default_layout.replaced(spec=None), None)
