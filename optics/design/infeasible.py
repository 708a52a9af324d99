"""The answer to a request that no layout can meet."""

from __future__ import annotations

from mirrorcam.optics.base.values import InputError

GAVE_UP = "every"
"""The constraint named where the search found no layout and cannot say why: that shows nothing about the spec."""


class InfeasibleDesign(InputError):
    """No layout meets the spec; the message names the constraint that cannot hold and by how much it is missed."""

    def __init__(self, constraint: str, finding: str) -> None:
        super().__init__(f"infeasible design, {constraint} constraint: {finding}")
        self.constraint = constraint
        self.finding = finding
