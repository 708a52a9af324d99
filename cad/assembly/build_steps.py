"""The steps of building a device, in order: what each joins, and when calibration pictures are taken.

The guide's headings, and the check of what the camera sees in those pictures, both follow this table.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from mirrorcam.cad.plan.device_names import CARRIER, CLIP, HOLDER, MOUNT

CAMERA = "camera"
# Regular expressions of the names.
MIRROR, ADAPTER, CARRIERS = r"mirror_\d+(?:-\d+)?", r"adapter_\w+", rf"{CARRIER}\d+(?:-\d+)?"


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
    Step("mirrors", ((MIRROR, HOLDER), (MIRROR, CARRIERS), (CARRIERS, HOLDER))),
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
    names = set(pieces) - {CAMERA}
    together = _hanging_with({CAMERA}, names, _joined_until(steps, last))
    together |= {
        name
        for name, parts in fastened.items()
        if all(any(is_piece_of(held, part) for held in together) for part in parts)
    }
    return together - {CAMERA}


def parts_when_joined(joins: Iterable[str], pieces: Iterable[str], steps: Iterable[Step] = STEPS) -> set[str]:
    """The pieces that are there when parts are screwed together: all that hangs together with them after that step.

    Parameters
    ----------
    joins : iterable of str
        Names of the parts that a fastener joins; of one part, what it holds in this.
    pieces : iterable of str
        Names of all pieces of the assembled device but fasteners; "mount_1" is of a split part.
    steps : iterable of Step
        All steps, in order: the one is taken that joins both parts, else the first by which each has been joined to
        something; all of them where there is none.

    Returns
    -------
    set of str
        Names of pieces.
    """
    parts, order, names = tuple(joins), tuple(steps), set(pieces)
    last = next((step for step in order if any(_makes_one(pair, parts) for pair in step.joins)), None)
    if last is None:
        seen: list[str] = []
        for step in order:
            seen += [kind for pair in step.joins for kind in pair]
            if all(any(is_piece_of(part, kind) for kind in seen) for part in parts):
                last = step
                break
    started = {name for name in names if any(is_piece_of(name, part) for part in parts)}
    return _hanging_with(started, names, _joined_until(order, last or order[-1]))


def _makes_one(pair: tuple[str, str], parts: tuple[str, ...]) -> bool:
    return len(parts) == 2 and any(
        is_piece_of(parts[0], first) and is_piece_of(parts[1], second) for first, second in (pair, pair[::-1])
    )


def _joined_until(steps: Iterable[Step], last: Step) -> list[tuple[str, str]]:
    joins: list[tuple[str, str]] = []
    for step in steps:
        joins += step.joins
        if step is last:
            break
    return joins


def _hanging_with(start: set[str], names: set[str], joins: list[tuple[str, str]]) -> set[str]:
    """A set of pieces, and all that pairs of patterns join to it, directly or by others."""
    together = set(start)
    while grown := {
        name
        for name in names - together
        for pair in joins
        for mine, other in (pair, pair[::-1])
        if is_piece_of(name, mine) and any(is_piece_of(held, other) for held in together)
    }:
        together |= grown
    return together


def is_piece_of(name: str, kind: str) -> bool:
    """Whether a piece's name is of a kind: "mount" and "mount_1" are of "mount"."""
    return re.fullmatch(rf"(?:{kind})(?:_\d+)?", name) is not None
