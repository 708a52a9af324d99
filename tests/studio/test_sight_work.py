"""What a design would see, as pictures for the page."""

from __future__ import annotations

import base64
from collections import OrderedDict

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio import sight_work


def picture(data_url: str) -> NDArray[np.uint8]:
    head, _, data = data_url.partition(",")
    assert head == "data:image/jpeg;base64"
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.asarray(decoded)


def test_a_frame_is_decoded_and_focused_on_any_depth(default_layout: Layout) -> None:
    layout = default_layout.replaced(spec=DesignSpec())
    frame = picture(sight_work.frame(layout, "tabletop").picture)
    assert frame.shape == (360, 640, 3)
    assert frame.std() > 20
    decoded = sight_work.decoded(layout, "tabletop")
    assert decoded.near_mm < 300.0 < 500.0 < decoded.far_mm
    assert decoded.error_mm is not None
    assert decoded.error_mm < 10.0
    near, far = (picture(sight_work.refocused(layout, "tabletop", mm).picture) for mm in (300.0, 500.0))
    assert near.shape == far.shape == picture(decoded.depth).shape
    assert np.abs(near.astype(float) - far).mean() > 2.0


def test_a_recently_decoded_design_is_refocused_after_another_was_decoded(
    default_layout: Layout, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sight_work, "_cached", OrderedDict())
    layout = default_layout.replaced(spec=DesignSpec())
    sight_work.decoded(layout, "board")
    with pytest.raises(InputError, match="no longer decoded"):
        sight_work.refocused(layout, "tabletop", 400.0)
    first = sight_work.refocused(layout, "board", 400.0)
    sight_work.decoded(layout, "tabletop")
    assert sight_work.refocused(layout, "board", 400.0) == first
    monkeypatch.setattr(sight_work, "MAX_CACHED", 1)
    sight_work.decoded(layout, "tabletop")
    with pytest.raises(InputError, match="no longer decoded"):
        sight_work.refocused(layout, "board", 400.0)
