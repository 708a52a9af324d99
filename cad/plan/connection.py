"""How two parts meet: the frame of their joint, once from the plan of each."""

from __future__ import annotations

from dataclasses import dataclass

from mirrorcam.core.values import FloatArray


@dataclass(frozen=True)
class Connection:
    """A joint of two parts: the same frame, once from the plan of each; both (4, 4) in rig.

    z points out of the parent. `slides_mm` is how far the child may move either way along the frame's x.
    """

    name: str
    parent: str
    child: str
    rig_from_parent_joint: FloatArray
    rig_from_child_joint: FloatArray
    slides_mm: float = 0.0
