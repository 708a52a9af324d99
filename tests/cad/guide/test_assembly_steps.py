"""Assembly steps: every bought component once, with the segment of the part that it is in."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import trimesh

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.guide.assembly_steps import Stages, home_of
from mirrorcam.cad.guide.device_pictures import pictures_of
from tests.cad.guide.conftest import Made


def test_the_guide_takes_every_bought_piece_once(made: Made) -> None:
    stages = Stages(made.components)
    taken = [
        *stages.threads,
        *stages.pins,
        *stages.holder_screws,
        *stages.camera_screws,
        *stages.clip_screws,
        *stages.adapter_screws,
        *stages.back_nuts,
    ]
    assert Counter(component.name for component in taken) == Counter(
        component.name for component in stages.of_kind("screw", "washer", "insert", "nut", "pin")
    )
    assert len(taken) == len(purchased_items(made.device))


def test_fasteners_find_their_piece_of_a_part_that_is_split(made: Made) -> None:
    holder = next(component for component in made.components if component.name == "mirror_holder")
    rest = [component for component in made.components if component.name != "mirror_holder"]
    low, high = np.asarray(holder.mesh.bounds)
    halves = []
    for number, side in ((1, -1.0), (2, 1.0)):
        ends = np.array([low, high])
        ends[0 if side > 0.0 else 1, 0] = 0.0
        half = replace(holder, name=f"mirror_holder_{number}", mesh=trimesh.creation.box(bounds=ends))
        halves.append(replace(half, explode_mm=holder.explode_mm + np.array([40.0 * side, 0.0, 0.0])))
    components = (*halves, *rest)
    stages = Stages(components)
    assert len(stages.threads_in(halves)) == 4
    assert Counter(component.kind for component in stages.holder_screws) == {"screw": 4}
    for thread in stages.threads_in(halves):
        home = home_of(thread, "mirror_holder", halves)
        assert home is not None
        assert np.sign(home.explode_mm[0]) == np.sign(thread.mesh.bounds.mean(axis=0)[0])
    drawn = {picture.name: picture for picture in pictures_of(made.device, made.parts, components)}
    assert len(drawn["inserts"].items) > len(stages.threads)
