"""Mirrors on double-sided tape: the stiffness of the tape on printed pads, its stress, and how far mirrors creep.

The tape is a film with a soft adhesive on both sides. A pad that is inclined to the layers prints as stairs. The film
rests on their edges, and the adhesive under it, half as thick as the tape, reaches the treads in strips. Layers are
bonded and incompressible, with the compression moduli of Gent and Lindley, The compression of bonded rubber blocks
(1959): 4 G (1 + S^2) for a strip, 3 G (1 + 2 S^2) for a disc, where S is the loaded area over the free one.
"""

from __future__ import annotations

import numpy as np
from shapely import Polygon

from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.plan.hardware import MIRROR_DENSITIES, TAPE_STRESS_KPA, Hardware, mirror_weight_n
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import inverse, transform

# Shear modulus of the adhesive after 1000 h. Adhesives with more than 0.1 MPa at 1/s do not stick (Dahlquist); 3 % of
# that is assumed to remain, since crosslinked acrylic adhesives soften to a plateau and do not flow.
SHEAR_MPA = 0.003
# Rotation of a mirror in 1000 h: as much as the creep of holder, mount and clip rotates it (docs/elasticity.md).
CREEP_DEG = 0.01


def layer_stiffness(mirror: Mirror, back_normal: FloatArray, hardware: Hardware) -> tuple[float, float]:
    """Stiffness of tape in N/mm per mm2 of pad, after 1000 h: along the mirror's normal, and in its plane.

    `back_normal` (3,) is the direction in which the holder's layers are stacked. With strips of width d / tan a on
    stairs inclined by the angle a, and adhesive of the depth d, on the mean d / 2 thick, S is 1 / tan a.
    """
    depth = hardware.holder.tape_mm / 2.0
    cosine = abs(float(mirror.normal_in_rig @ back_normal))
    sine2 = max(1.0 - cosine**2, 1e-9)
    strip = 4.0 * SHEAR_MPA / sine2
    disc = 3.0 * SHEAR_MPA * (1.0 + 2.0 * (hardware.holder.tape_pad_mm / (4.0 * depth)) ** 2)
    share = hardware.holder.bonded_share
    # The layers under the film and above it, in series.
    normal = 1.0 / (depth / 2.0 / (share * min(strip, disc)) + depth / disc)
    shear = 1.0 / (depth / 2.0 / (share * SHEAR_MPA) + depth / SHEAR_MPA)
    return normal, shear


def check_tape(layout: Layout, holder: HolderPlan, hardware: Hardware) -> dict[str, Metric]:
    """Check the tape behind mirrors under their weight; {} for mirrors without tape.

    Reports the largest stress, with the weight along the normal, and the largest rotation in 1000 h, with the weight in
    the mirror's plane at its centre, in front of the pads.
    """
    if hardware.holder.mirrors != "tape":
        return {}
    normal = holder.rig_from_mount[:3, 2]
    stresses, rotations = [], []
    for mirror, pads in zip(layout.mirrors, holder.pads_of_mirrors, strict=True):
        tops = [transform(inverse(mirror.rig_from_plane), pad.top)[:, :2] for pad in pads]
        areas = np.array([Polygon(top).area for top in tops])
        centres = np.array([Polygon(top).centroid.coords[0] for top in tops])
        weight_n = mirror_weight_n(mirror, MIRROR_DENSITIES[hardware.cutting.material])
        stiffness = layer_stiffness(mirror, normal, hardware)[0] * areas
        offsets = centres - np.average(centres, axis=0, weights=areas)
        centroid = np.array(Polygon(mirror.outline_in_plane_mm).centroid.coords[0])
        eccentric = float(np.linalg.norm(centroid - np.average(centres, axis=0, weights=areas)))
        arm = max(mirror.thickness_mm / 2.0 + hardware.holder.tape_mm, eccentric)
        softest = float(np.linalg.eigvalsh((stiffness[:, None] * offsets).T @ offsets)[0])
        stresses.append(1000.0 * weight_n / (hardware.holder.bonded_share * float(areas.sum())))
        rotations.append(float(np.degrees(weight_n * arm / softest)))
    return {
        "tape_kpa": Metric(value=round(max(stresses), 3), unit="kPa", limit=TAPE_STRESS_KPA),
        "tape_creep_deg": Metric(value=round(max(rotations), 5), unit="deg", limit=CREEP_DEG),
    }
