"""How a camera sits in its clip: forces at the six points, strain of the leaves, and how well it repeats."""

from __future__ import annotations

import manifold3d

from mirrorcam.cad.parts.camera_box import GRAVITY_N_PER_KG, body_box, least_contact_n
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.reclamping import repeatability
from mirrorcam.cad.plan.device_names import CLIP
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.layout import Layout

# Gaps beyond this are not measured.
NEAR_MM = 5.0


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
        f"{CLIP}.{name}": Metric(value=round(value, digits), unit=unit)
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
        f"{CLIP}.contact_n": Metric(value=round(least, 2), unit="N", limit=0.0, lower_is_better=False),
        f"{CLIP}.leaf_strain": Metric(value=round(strain, 5), unit="", limit=printer.plastic_strain),
        f"{CLIP}.back_screw_n": Metric(value=round(forces[0], 1), unit="N"),
        f"{CLIP}.end_screw_n": Metric(value=round(forces[1], 1), unit="N"),
        **reclamped,
    }


def check_rest(
    clip: manifold3d.Manifold | None, camera: manifold3d.Manifold | None, hardware: Hardware
) -> dict[str, Metric]:
    """Check that a lens that rests on its clip can be drawn onto it, as far as the play of its board's holes.

    Parameters
    ----------
    clip, camera : Manifold or None
        The solids as they stand in the device, in rig, mm; None where one is not valid.
    hardware : Hardware
        The camera's body; one without `rest_mm` has nothing to check.

    Returns
    -------
    dict of str to Metric
        The gap between clip and barrel over the board; without either solid, as large as is looked for.
    """
    body = hardware.camera
    if body.rest_mm is None or not isinstance(body.held_by, BoardHoles):
        return {}
    # Posts and board end below the rest.
    over = body.pupil_behind_front_mm + body.rest_mm[0] / 2.0
    gap = NEAR_MM
    if clip is not None and camera is not None:
        upper = [solid.trim_by_plane((0.0, 0.0, 1.0), over) for solid in (clip, camera)]
        gap = min(float(upper[0].min_gap(upper[1], NEAR_MM)), NEAR_MM)
    return {f"{CLIP}.rest_gap_mm": Metric(value=round(gap, 3), unit="mm", limit=round(body.held_by.play_mm, 3))}
