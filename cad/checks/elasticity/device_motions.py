"""Motions of a device's mirrors relative to its camera, by finite elements of the holder, the mount and the clip.

Parts are tied at their screws, each a rigid disc in both parts; the foot's screws are fixed. Mirrors and camera are
rigid. The camera's weight is distributed over the nodes on which it rests, and it follows their mean motion. A mirror
is connected to its seat by springs, with the stiffness of a layer of silicone on the floor, or of tape on the pads
after 1000 h, and expands independently. Plastics differ in modulus, expansion and creep.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from build123d import Part
from numpy.typing import NDArray
from shapely import Polygon, points

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.elasticity.condensed_solid import LOADS, Carried, CondensedSolid, Solid
from mirrorcam.cad.checks.elasticity.tetrahedra import Tetrahedra, tetrahedra_of
from mirrorcam.cad.checks.tape_mounting import layer_stiffness
from mirrorcam.cad.holder.holder_solid import make_holder
from mirrorcam.cad.holder.pads import PADS, pad_shapes
from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.part_solids import make_clip, make_mount
from mirrorcam.cad.plan.device_names import CLIP, HOLDER, MOUNT
from mirrorcam.cad.plan.hardware import MIRROR_DENSITIES, Hardware
from mirrorcam.cad.plan.seats import pad_height_mm, seat_height_mm
from mirrorcam.cad.write.part_export import write_step
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import inverse, transform


@dataclass(frozen=True)
class Plastic:
    """A plastic as printed, at 20 to 25 deg C.

    `creep` is the additional strain after 1000 h under a constant small stress, as a multiple of the elastic strain.
    `swelling` is the strain from dry to room humidity. A number with the `source` "from memory" is typical of data
    sheets and was not looked up.
    """

    name: str
    modulus_mpa: float
    density_g_per_cm3: float
    cte_per_k: float
    glass_transition_c: float
    creep: float
    swelling: float
    source: str


PLASTICS = (
    Plastic(
        "PLA", 2300.0, 1.24, 68e-6, 60.0, 0.5, 3e-4,
        "modulus: Polymaker PolyTerra, 2.0 to 2.2 GPa, Stratasys 2.5 to 3.0; Tg 60.6 C (PolyTerra), 63 C (Stratasys); "
        "expansion from memory (Stratasys has 101e-6); creep from memory",
    ),
    Plastic(
        "PETG", 1900.0, 1.27, 60e-6, 80.0, 0.5, 3e-4,
        "modulus 2 to 3 GPa, density, Tg 75 to 85 C: additive.tools; expansion and creep from memory",
    ),
    Plastic("ASA", 1900.0, 1.07, 95e-6, 100.0, 0.6, 3e-4, "all from memory"),
    Plastic("ABS", 1900.0, 1.04, 90e-6, 105.0, 0.7, 3e-4, "modulus 2.0 GPa: Wohlers 2011; the rest from memory"),
    Plastic(
        "PA-CF", 3500.0, 1.2, 60e-6, 60.0, 0.9, 5e-3,
        "expansion 22e-6 along the lines, 248e-6 across layers, swelling .5 to 1.5 %: Faust et al. 2021, "
        "doi 10.3390/polym13213637 (the values are means within a layer); the rest from memory, of moist nylon",
    ),
)  # fmt: skip
MIRROR_CTE_PER_K = {"acrylic": 70e-6, "glass": 9e-6}
"""Thermal expansion of mirrors by material, cast acrylic and float glass, from memory."""
SUPPORT_CTE_PER_K = 12e-6
"""Thermal expansion of the steel support to which the foot is screwed."""


def plastic_named(name: str, modulus_mpa: float, density_g_per_cm3: float) -> Plastic:
    """A plastic of the table with a printer's modulus and density; raises InputError if it is not in the table."""
    for plastic in PLASTICS:
        if plastic.name.casefold() == name.casefold():
            return replace(plastic, modulus_mpa=modulus_mpa, density_g_per_cm3=density_g_per_cm3)
    raise InputError(
        f"printer.plastic = {name}: its expansion and creep are unknown, expected one of "
        f"{', '.join(plastic.name for plastic in PLASTICS)} for finite elements"
    )


G = 9.80665
# Radius of the disc, rigid in the model, in which a screw clamps parts.
CLAMP_RADIUS_MM = 6.0
# Largest distance of nodes from their plane, and radius around a camera's contacts within which nodes carry it.
IN_PLANE_MM, CONTACT_RADIUS_MM = 5e-3, 3.0
CAMERA = "camera"
# Neutral-cure silicone, 20 to 25 Shore A, in MPa: its shear modulus, and the modulus of a laterally confined layer,
# for a Poisson's ratio of .49.
GLUE_SHEAR_MPA, GLUE_LAYER_MPA = 0.3, 15.0


@dataclass(frozen=True)
class DeviceMotions:
    """Motions of each mirror relative to the camera, by name: shift in mm of its mean point, then rotation in rad.

    `per_plastic_weight` and `per_carried_weight` (6, 3) are for gravity along x, y and z of the rig frame, acting on
    plastic of 1 g/cm3 and on the carried bodies, both for a modulus of 1 MPa. `per_plastic_strain`,
    `per_support_strain` and `per_mirror_strain` (6,) are for a unit strain of all plastic, of the support, and of the
    mirrors, whose thermal expansion is `mirror_cte_per_k`.
    """

    per_plastic_weight: Mapping[str, FloatArray]
    per_carried_weight: Mapping[str, FloatArray]
    per_plastic_strain: Mapping[str, FloatArray]
    per_support_strain: Mapping[str, FloatArray]
    per_mirror_strain: Mapping[str, FloatArray]
    mirror_cte_per_k: float

    def under_gravity(self, modulus_mpa: float, density_g_per_cm3: float) -> dict[str, FloatArray]:
        """Motions (6, 3) due to gravity along x, y and z of the rig frame, for parts of one plastic."""
        return {
            name: (density_g_per_cm3 * own + self.per_carried_weight[name]) / modulus_mpa
            for name, own in self.per_plastic_weight.items()
        }

    def under_strain(self, plastic: float, support: float, mirrors: float) -> dict[str, FloatArray]:
        """Motions (6,) due to strains of the plastic, the support and the mirrors."""
        return {
            name: plastic * own + support * self.per_support_strain[name] + mirrors * self.per_mirror_strain[name]
            for name, own in self.per_plastic_strain.items()
        }


@dataclass(frozen=True)
class TiedPart:
    """A solid with its screws, by their indices in the device, and the bodies that it carries."""

    solid: Solid
    screws: tuple[int, ...]
    carried: Mapping[str, Carried]


def device_motions(device: Device, size_mm: float) -> DeviceMotions:
    """Solve the device with elements of a given size; raises InputError if gmsh is missing or cannot mesh a part."""
    mount, clip, foot = device.mount, device.clip, device.mount.foot.screws_in_rig
    head = transform(mount.rig_from_head, np.column_stack([mount.holes_in_head_mm, np.zeros(4)]))
    slide = clip.slide_points
    centres = np.vstack([foot, head, slide])
    up, to_scene = mount.foot.up_in_rig, np.array([0.0, 1.0, 0.0])
    axes = np.array([*[up] * len(foot), *[mount.rig_from_head[:3, 2]] * len(head), *[to_scene] * len(slide)])
    feet, heads, slides = (
        tuple(range(*ends))
        for ends in ((0, len(foot)), (len(foot), len(foot) + len(head)), (len(centres) - len(slide), len(centres)))
    )
    solids = {
        name: Solid(_meshed(part, name, size_mm))
        for name, part in {
            HOLDER: make_holder(device.holder),
            MOUNT: make_mount(mount),
            CLIP: make_clip(clip),
        }.items()
    }
    parts = (
        TiedPart(solids[HOLDER], heads, _mirrors(device, solids[HOLDER].nodes)),
        TiedPart(solids[MOUNT], (*feet, *heads, *slides), {}),
        TiedPart(solids[CLIP], slides, {CAMERA: _camera(device, solids[CLIP].nodes)}),
    )
    clamped = [discs(part.solid.nodes, centres[list(part.screws)], axes[list(part.screws)]) for part in parts]
    return tied_motions(parts, clamped, centres, feet, MIRROR_CTE_PER_K[device.hardware.cutting.material])


def tied_motions(
    parts: Sequence[TiedPart],
    clamped: Sequence[Sequence[NDArray[np.int64]]],
    centres: FloatArray,
    feet: Sequence[int],
    mirror_cte_per_k: float,
) -> DeviceMotions:
    """Motions, relative to `CAMERA`, of all carried bodies.

    Parameters
    ----------
    parts : sequence of TiedPart
        Parts with a common screw are tied there.
    clamped : sequence of sequence of (n,) arrays
        For each part and each of its screws, the nodes that the screw clamps.
    centres : (k, 3) array
        Centres of all screws in the rig frame, mm.
    feet : sequence of int
        The fixed screws.
    mirror_cte_per_k : float
        Coefficient of thermal expansion of the glued bodies, 1/K.

    Raises
    ------
    InputError
        If a screw clamps too few nodes.
    """
    condensed = [
        part.solid.condensed(nodes, centres[list(part.screws)], part.carried)
        for part, nodes in zip(parts, clamped, strict=True)
    ]
    return _solved(parts, condensed, centres, feet, mirror_cte_per_k)


def _meshed(part: Part, name: str, size_mm: float) -> Tetrahedra:
    with TemporaryDirectory() as folder:
        step = Path(folder, f"{name}.step")
        write_step(step, part)
        return tetrahedra_of(step, size_mm)


def discs(nodes: FloatArray, centres: FloatArray, axes: FloatArray) -> list[NDArray[np.int64]]:
    """The nodes around each screw, in the plane where it enters a part; a node belongs to the nearest screw."""
    distances = np.linalg.norm(nodes[:, None] - centres, axis=2)
    offsets = np.abs(np.einsum("nsk,sk->ns", nodes[:, None] - centres, axes))
    nearest = distances.argmin(axis=1)
    return [
        np.flatnonzero((nearest == screw) & (distances[:, screw] < CLAMP_RADIUS_MM) & (offsets[:, screw] < IN_PLANE_MM))
        for screw in range(len(centres))
    ]


def _mirrors(device: Device, nodes: FloatArray) -> dict[str, Carried]:
    """The mirrors, each on the nodes of its seat: of the floor with glue, of the pads with tape."""
    density = MIRROR_DENSITIES[device.hardware.cutting.material]
    carried = {}
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        outline = Polygon(mirror.outline_in_plane_mm)
        in_plane = transform(inverse(mirror.rig_from_plane), nodes)
        taped = device.hardware.holder.mirrors == "tape"
        height = (pad_height_mm if taped else seat_height_mm)(mirror, device.hardware)
        in_level = np.abs(in_plane[:, 2] - height) < IN_PLANE_MM
        seat = np.flatnonzero(in_level & outline.covers(points(in_plane[:, :2])))
        if len(seat) < 3:
            raise InputError(
                f"seat of mirror {name} has {len(seat)} nodes of the mesh, expected at least 3 (finer elements)"
            )
        mass_g = density * outline.area * mirror.thickness_mm / 1000.0
        point = mirror.rig_from_plane[:3, 3]
        centroid = np.array([*outline.centroid.coords[0], mirror.back_mm + mirror.thickness_mm / 2.0])
        layer = (_tape if taped else _glue)(mirror, outline.area, len(seat), device)
        carried[name] = Carried(seat, point, mass_g / 1000.0 * G, transform(mirror.rig_from_plane, centroid), layer)
    return carried


def _glue(mirror: Mirror, area_mm2: float, count: int, device: Device) -> FloatArray:
    """Springs (count, 3, 3) of a layer of glue behind a mirror."""
    hardware = device.hardware
    moduli = np.array([GLUE_LAYER_MPA, GLUE_SHEAR_MPA])
    return _springs(mirror, moduli * area_mm2 / hardware.holder.bond_mm, count, hardware)


def _tape(mirror: Mirror, _: float, count: int, device: Device) -> FloatArray:
    """Springs (count, 3, 3) of the tape on a mirror's pads."""
    hardware = device.hardware
    pads_mm2 = PADS * Polygon(pad_shapes(np.zeros((1, 2)), hardware)[0]).area
    per_mm2 = np.array(layer_stiffness(mirror, device.holder.rig_from_mount[:3, 2], hardware))
    return _springs(mirror, per_mm2 * pads_mm2, count, hardware)


def _springs(mirror: Mirror, stiffness: FloatArray, count: int, hardware: Hardware) -> FloatArray:
    """Springs (count, 3, 3) with a total stiffness (2,), in N/mm, along a mirror's normal and in its plane.

    They are scaled as if the plastic's modulus were 1 MPa.
    """
    normal = mirror.rig_from_plane[:3, 2]
    along = np.outer(normal, normal)
    total = stiffness[0] * along + stiffness[1] * (np.eye(3) - along)
    return np.tile(total / count / hardware.printer.plastic_mpa, (count, 1, 1))


def _camera(device: Device, nodes: FloatArray) -> Carried:
    """The camera, on the nodes around its points of contact."""
    nest, body = device.clip.nest, body_box(device.hardware.camera)
    contacts = np.array([screw.head for screw in device.clip.screws]) if nest is None else nest.points
    carrying = np.linalg.norm(nodes[:, None] - contacts, axis=2).min(axis=1) < CONTACT_RADIUS_MM
    centre = (body.low + body.high) / 2.0
    return Carried(np.flatnonzero(carrying), np.zeros(3), device.hardware.camera.mass_g / 1000.0 * G, centre)


def _solved(
    parts: Sequence[TiedPart],
    condensed: Sequence[CondensedSolid],
    centres: FloatArray,
    feet: Sequence[int],
    mirror_cte_per_k: float,
) -> DeviceMotions:
    """Join the parts at their screws and solve; columns of loads are in the order of `DeviceMotions`."""
    count = 6 * len(centres)
    stiffness, forces = np.zeros((count, count)), np.zeros((count, 9))
    # Specific weight of plastic of 1 g/cm3, in N/mm3.
    loads = np.zeros((LOADS, 9))
    loads[[0, 1, 2], [0, 1, 2]] = G * 1e-6
    loads[[3, 4, 5, 6, 7], [3, 4, 5, 6, 8]] = 1.0
    dofs = [(np.array(part.screws)[:, None] * 6 + np.arange(6)).ravel() for part in parts]
    for part_dofs, solid in zip(dofs, condensed, strict=True):
        stiffness[np.ix_(part_dofs, part_dofs)] += solid.stiffness
        forces[part_dofs] += solid.forces @ loads
    motions = np.zeros((count, 9))
    fixed = (np.array(feet)[:, None] * 6 + np.arange(6)).ravel()
    for foot in feet:
        motions[6 * foot : 6 * foot + 3, 7] = centres[foot] - centres[list(feet)].mean(axis=0)
    free = np.setdiff1d(np.arange(count), fixed)
    residual = forces[free] - stiffness[np.ix_(free, fixed)] @ motions[fixed]
    motions[free] = np.linalg.solve(stiffness[np.ix_(free, free)], residual)
    carried = {
        name: solid.per_screws[name] @ motions[part_dofs] + solid.per_load[name] @ loads
        for part, part_dofs, solid in zip(parts, dofs, condensed, strict=True)
        for name in part.carried
    }
    reference = {name: body.point for part in parts for name, body in part.carried.items()}
    camera = carried.pop(CAMERA)
    relative = {}
    for name, motion in carried.items():
        arm = reference[name] - reference[CAMERA]
        shift = motion[:3] - camera[:3] - np.cross(camera[3:], arm, axisa=0).T
        relative[name] = np.vstack([shift, motion[3:] - camera[3:]])
    return DeviceMotions(
        per_plastic_weight={name: motion[:, :3] for name, motion in relative.items()},
        per_carried_weight={name: motion[:, 3:6] for name, motion in relative.items()},
        per_plastic_strain={name: motion[:, 6] for name, motion in relative.items()},
        per_support_strain={name: motion[:, 7] for name, motion in relative.items()},
        per_mirror_strain={name: motion[:, 8] for name, motion in relative.items()},
        mirror_cte_per_k=mirror_cte_per_k,
    )
