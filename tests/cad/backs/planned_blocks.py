"""The plan of a back's part made of blocks."""

from __future__ import annotations

from mirrorcam.cad.backs.back import BackPart
from mirrorcam.cad.backs.blocks import BlocksPlan


def blocks_of(part: BackPart) -> BlocksPlan:
    """The plan of such a part."""
    assert isinstance(part.plan, BlocksPlan)
    return part.plan
