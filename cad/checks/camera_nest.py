"""How a camera sits in its clip: forces at the six points, strain of the leaves, and how well it repeats."""

from __future__ import annotations

from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.nest import GRAVITY_N_PER_KG, least_contact_n
from mirrorcam.cad.parts.reclamping import repeatability
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.optics.base.values import Metric
from mirrorcam.optics.geometry.layout import Layout


def check_nest(clip: ClipPlan, layout: Layout, hardware: Hardware) -> dict[str, Metric]:
    """Check that the screws press a body on all six points, and bend their leaves no further than lasts.

    Parameters
    ----------
    clip : ClipPlan
        The clip; one that holds a board by its screws has no points nor leaves to check.
    layout : Layout
        Camera and mirrors: how sub-images move.
    hardware : Hardware
        The camera's mass, the acceleration that the nest withstands, and the plastic.

    Returns
    -------
    dict of str to Metric
        The least force at any point at that acceleration, the greatest strain of a leaf; as figures the screws' forces;
        and of a board too, what re-clamping does, one standard deviation.
    """
    repeats = repeatability(clip, layout, hardware)
    figures = {
        "reclamped_mm": (repeats.shift_mm, "mm", 4),
        "reclamped_deg": (repeats.turn_deg, "deg", 4),
        "reclamped_px": (repeats.image_px, "px", 2),
        "reclamped_between_views_px": (repeats.between_views_px, "px", 3),
    }
    reclamped = {
        f"camera_clip.{name}": Metric(value=round(value, digits), unit=unit)
        for name, (value, unit, digits) in figures.items()
    }
    if clip.nest is None:
        return reclamped
    printer, camera = hardware.printer, hardware.camera
    weight = camera.mass_g / 1000.0 * GRAVITY_N_PER_KG * hardware.clip.shaken_g
    least = least_contact_n(clip.nest, body_box(camera).middle, weight, printer.plastic_mpa)
    forces = [screw.leaf.force_n(printer.plastic_mpa) for screw in clip.nest.screws]
    strain = max(screw.leaf.strain for screw in clip.nest.screws)
    return {
        "camera_clip.contact_n": Metric(value=round(least, 2), unit="N", limit=0.0, lower_is_better=False),
        "camera_clip.leaf_strain": Metric(value=round(strain, 5), unit="", limit=printer.plastic_strain),
        "camera_clip.back_screw_n": Metric(value=round(forces[0], 1), unit="N"),
        "camera_clip.end_screw_n": Metric(value=round(forces[1], 1), unit="N"),
        **reclamped,
    }
