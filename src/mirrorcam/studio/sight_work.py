"""Simulated frames of a design, rendered and decoded in a process of the studio; the latest are kept for refocusing."""

from __future__ import annotations

import base64
from collections import OrderedDict
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.design_work import at_low_priority

if TYPE_CHECKING:
    from mirrorcam.render_scenes.preview.preview_frame import PreviewFrame
    from mirrorcam.render_scenes.preview.products import PreviewProducts

Subject = Literal["tabletop", "board"]
WIDTH_PX = 640
QUALITY = 90


class Frame(Value):
    """A frame of the camera: a JPEG picture as a data URL."""

    picture: str


class Decoded(Value):
    """Products of a frame: pictures as data URLs, depths in mm.

    `focus_mm` is the depth of focus of `refocused`, `error_mm` the median error of the depth map, null if unknown.
    """

    views: str
    refocused: str
    depth: str
    near_mm: float
    far_mm: float
    focus_mm: float
    error_mm: float | None


MAX_CACHED = 12
_frame: tuple[str, PreviewFrame] | None = None
_cached: OrderedDict[str, PreviewProducts] = OrderedDict()
"""The last decoded frames by name: several open pages may show different designs."""


def _name(layout: Layout, subject: Subject) -> str:
    return f"{layout.identity} {subject}"


def frame(layout: Layout, subject: Subject) -> Frame:
    """Render a frame of the tabletop or of a board, at low priority.

    Raises InputError if there is no room for the subject.
    """
    at_low_priority()
    from mirrorcam.render_scenes.preview.preview_frame import preview_frame

    global _frame
    _frame = (_name(layout, subject), preview_frame(layout, subject, WIDTH_PX))
    return Frame(picture=_data_url(_frame[1].picture))


def decoded(layout: Layout, subject: Subject) -> Decoded:
    """Return views, a refocused picture and depth of a frame. Raises InputError if the views have no common field."""
    from mirrorcam.render_scenes.preview.products import preview_products

    name = _name(layout, subject)
    if _frame is None or _frame[0] != name:
        frame(layout, subject)
    assert _frame is not None
    products = preview_products(_frame[1])
    _cached.pop(name, None)
    _cached[name] = products
    while len(_cached) > MAX_CACHED:
        _cached.popitem(last=False)
    near_mm, far_mm = products.search_range_mm
    focus_mm = 2.0 / (1.0 / near_mm + 1.0 / far_mm)
    error_mm = products.median_error_mm
    return Decoded(
        views=_data_url(products.views_picture()),
        refocused=_data_url(products.refocused(focus_mm)),
        depth=_data_url(products.depth_picture()),
        near_mm=near_mm,
        far_mm=far_mm,
        focus_mm=focus_mm,
        error_mm=None if np.isnan(error_mm) else error_mm,
    )


def refocused(layout: Layout, subject: Subject, depth_mm: float) -> Frame:
    """Return the picture refocused at a depth. Raises InputError unless this design was decoded recently."""
    products = _cached.get(_name(layout, subject))
    if products is None:
        raise InputError("this design is no longer decoded, expected one of the most recent")
    return Frame(picture=_data_url(products.refocused(depth_mm)))


def _data_url(picture: NDArray[np.uint8]) -> str:
    from mirrorcam.core.images.pictures import encoded_image

    return f"data:image/jpeg;base64,{base64.b64encode(encoded_image(picture, '.jpg', QUALITY)).decode()}"
