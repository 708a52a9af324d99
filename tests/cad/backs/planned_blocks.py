"""The plan of a part of a back that is made of blocks."""

from __future__ import annotations

from mirrorcam.cad.backs.back import BackPart
from mirrorcam.cad.backs.blocks import BlocksPlan


def blocks_of(part: BackPart) -> BlocksPlan:
    """The plan of such a part."""
    assert isinstance(part.plan, BlocksPlan)
    return part.plan
