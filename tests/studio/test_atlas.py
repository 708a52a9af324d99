"""An atlas holds every design of its grid once, and says why one cannot be."""

from __future__ import annotations

import json
import multiprocessing

import pytest

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.atlas import AtlasGrid, atlas, key_of

SMALL = AtlasGrid(rows=(1,), cols=(1, 2), scales_mm=(60.0,), tradeoffs=(0.1, 0.5))


@pytest.mark.slow
def test_every_combination_of_at_least_two_mirrors_is_designed() -> None:
    done: list[tuple[int, int]] = []
    found = atlas(DesignSpec(depths_mm=(300.0,)), SMALL, workers=1, progress=lambda k, n: done.append((k, n)))
    assert list(found["designs"]) == ["1,2,60,0.1", "1,2,60,0.5"]
    assert done == [(1, 2), (2, 2)]
    assert len(found["designs"]["1,2,60,0.1"]["mirrors"]) == 2
    assert json.loads(json.dumps(found, allow_nan=False)) == json.loads(json.dumps(found))
    assert not multiprocessing.active_children()


def test_a_request_that_cannot_be_has_its_finding() -> None:
    found = atlas(DesignSpec(seen_gap_mm=300.0), SMALL, workers=1)
    assert found["designs"]["1,2,60,0.1"]["constraint"] == "seen gap"


def test_the_whole_grid_goes_from_two_mirrors_to_twenty_five() -> None:
    specs = AtlasGrid().specs(DesignSpec())
    assert len(specs) == 24 * 4 * 3
    assert len({key_of(spec) for spec in specs}) == len(specs)
    assert {(spec.rows, spec.cols) for spec in specs} >= {(1, 2), (5, 5)}
