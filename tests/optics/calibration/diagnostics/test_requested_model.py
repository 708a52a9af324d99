"""The words of a requested model, and whether they are valid with a layout or a direct view."""

from __future__ import annotations

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel

parse = RequestedModel.parse


def test_words_name_a_model() -> None:
    assert parse("auto") == AUTO
    assert parse("joint") == RequestedModel()
    assert parse("paper") == RequestedModel(paper=True)
    assert parse("fisheye+paper") == RequestedModel(lens="fisheye", paper=True)
    assert parse("warp+sheet") == parse("joint+warp+sheet") == RequestedModel(additions=("warp", "sheet"))
    assert parse("joint+rational+prism") == RequestedModel(lens="rational", additions=("prism",))
    assert parse("spline+auto+second_surface") == RequestedModel(lens="spline", auto=True, surface="second")


@pytest.mark.parametrize(
    "text",
    [
        *("", "flat", "joint+glass", "bend+bend", "paper+bend", "paper+auto", "paper+joint", "rational+fisheye"),
        "first_surface+second_surface",
    ],
)
def test_unknown_and_contradictory_words_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="model"):
        parse(text)


@pytest.mark.parametrize("text", ["turn", "board+auto", "second_surface"])
def test_words_of_a_direct_view_and_surfaces_are_refused_with_the_layout_as_it_is(text: str) -> None:
    with pytest.raises(InputError, match="model: "):
        parse(text).check_mirrored()
    parse("rational+sheet+bend+warp+bow+prism+walk+auto").check_mirrored()
