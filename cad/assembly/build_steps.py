"""The steps of building a device, in order: what each joins, and when calibration pictures are taken.

The guide's headings, and the check of what the camera sees in those pictures, both follow this table.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

HOLDER, MOUNT, CLIP, CAMERA = "mirror_holder", "mount", "camera_clip", "camera"
# Regular expressions of the names.
MIRROR, ADAPTER = r"mirror_\d+(?:-\d+)?", r"adapter_\w+"


@dataclass(frozen=True)
class Step:
    """A step of the guide: pairs of pieces that it makes one, by patterns of their names.

    `pictures` is the folder of the calibration pictures that are taken at its end, "" where it takes none.
    """

    name: str
    joins: tuple[tuple[str, str], ...] = ()
    pictures: str = ""


STEPS = (
    Step("measure"),
    Step("print"),
    Step("cut"),
    Step("inserts"),
    Step("mirrors", ((MIRROR, HOLDER),)),
    Step("holder", ((HOLDER, MOUNT),)),
    Step("camera", ((CAMERA, CLIP),), pictures="base"),
    Step("clip", ((CLIP, MOUNT),)),
    Step("back", ((ADAPTER, MOUNT),)),
    Step("calibrate", pictures="frames"),
)


def with_camera(
    steps: Iterable[Step], last: Step, pieces: Iterable[str], fastened: Mapping[str, tuple[str, ...]]
) -> set[str]:
    """The pieces that hang together with the camera when a step is done, without the camera itself.

    Parameters
    ----------
    steps : iterable of Step
        All steps, in order.
    last : Step
        The one that is done.
    pieces : iterable of str
        Names of all pieces of the assembled device but fasteners; "mount_1" is of a split part.
    fastened : mapping of str to tuple of str
        Names of fasteners, each with the parts that it joins: it is there as soon as all of these are.

    Returns
    -------
    set of str
        Names of pieces and fasteners.
    """
    joins: list[tuple[str, str]] = []
    for step in steps:
        joins += step.joins
        if step is last:
            break
    names = set(pieces) - {CAMERA}
    together = {CAMERA}
    while grown := {
        name
        for name in names - together
        for pair in joins
        for mine, other in (pair, pair[::-1])
        if _is(name, mine) and any(_is(held, other) for held in together)
    }:
        together |= grown
    together |= {
        name for name, parts in fastened.items() if all(any(_is(held, part) for held in together) for part in parts)
    }
    return together - {CAMERA}


def _is(name: str, kind: str) -> bool:
    """Whether a piece's name is of a kind: "mount" and "mount_1" are of "mount"."""
    return re.fullmatch(rf"(?:{kind})(?:_\d+)?", name) is not None
