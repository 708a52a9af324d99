"""Views as parallel pinholes, and back: the form of structure-from-motion tools."""

from __future__ import annotations

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Views


def view_name(t: int, s: int) -> str:
    """Return the name of a view in files; sorted names are row by row."""
    return f"view_{t:02d}_{s:02d}"


def centres_in_rig_mm(views: Views) -> FloatArray:
    """Return the positions (t, s, 3) of the views in the rig frame, mm."""
    return views.positions_mm @ views.view_from_rig + views.reference_view_in_rig_mm
