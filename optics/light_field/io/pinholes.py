"""Views as parallel pinholes, and back: the form of structure-from-motion tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Views

Item = TypeVar("Item")


def view_name(t: int, s: int) -> str:
    """Return the name of a view in files; sorted names are row by row."""
    return f"view_{t:02d}_{s:02d}"


def row_by_row(views: Mapping[tuple[int, int], Item]) -> tuple[tuple[int, int], list[Item]]:
    """Return numbers of rows and columns, and the views row by row; raises ValueError if views are missing.

    The views are counted first, because malicious names could state a grid that fills the memory.
    """
    rows, cols = (1 + max(index[axis] for index in views) for axis in (0, 1))
    if len(views) != rows * cols:
        raise ValueError(f"{len(views)} views, expected {rows}x{cols}")
    return (rows, cols), [views[index] for index in np.ndindex(rows, cols)]


def centres_in_rig_mm(views: Views) -> FloatArray:
    """Return the positions (t, s, 3) of the views in the rig frame, mm."""
    return views.positions_mm @ views.view_from_rig + views.reference_view_in_rig_mm
