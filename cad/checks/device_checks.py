"""Checks of the complete device from its written files: mirrors in their seats, light, clashes and mass."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Self

import manifold3d
import numpy as np
import trimesh
from build123d import import_step
from shapely import Polygon

from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import (
    BRASS_DENSITY,
    STEEL_DENSITY,
    combined,
    item_names,
    mass_of,
)
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.adjustment import check_adjustment
from mirrorcam.cad.checks.clashes import (
    FASTENERS,
    FORMING,
    IN_CAMERA,
    check_clashes,
    check_cover,
    is_mirror,
    overlap_mm3,
)
from mirrorcam.cad.checks.cut_outlines import OutlineFit, check_cuts, mirror_fits, mirrors_as_cut, prism, read_cuts
from mirrorcam.cad.checks.exported_mesh import is_manifold, read_stl, solid_of
from mirrorcam.cad.checks.light_paths import check_light, check_step_views, check_surrounding_light
from mirrorcam.cad.checks.load_checks import check_aim, check_back, check_nest, check_rest
from mirrorcam.cad.checks.reach import check_insertion, check_tool_reach
from mirrorcam.cad.checks.seat_checks import check_seats, flat_faces
from mirrorcam.cad.checks.tape_mounting import check_tape
from mirrorcam.cad.holder.stray_light import MAX_STRAY_LIGHT, stray_light
from mirrorcam.cad.plan.device_names import CAMERA, CARRIER, CLIP, COVER, HOLDER, UNMOUNTED
from mirrorcam.cad.plan.hardware import MIRROR_DENSITIES, Hardware
from mirrorcam.cad.plan.part_plan import BuiltPart, MassProperties
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout

ASSEMBLY = "assembly.glb"
# Height above its seat from which a mirror is lowered, as a multiple of its thickness.
DROP_HEIGHT_RATIO = 4.0
# Reduction of the tested clearance around a mirror, so that walls exactly at the clearance do not clash.
ROUNDING_MM = 1e-3


@dataclass(frozen=True)
class DeviceAsMade:
    """A device as read back from its folder: parts as printed, mirrors as cut, other pieces as assembled.

    `outlines` are the mirrors' outlines in the files `sheets`, by row and column. `assembly` has the meshes of the
    assembly and `solids` the solids of all pieces, both by name, in the rig frame, mm.
    """

    device: Device
    printed: Sequence[BuiltPart]
    sheets: Sequence[Path]
    outlines: Mapping[str, OutlineFit]
    assembly: Mapping[str, trimesh.Trimesh]
    solids: Mapping[str, manifold3d.Manifold]

    @classmethod
    def read(cls, device: Device, parts: Sequence[BuiltPart], folder: Path) -> Self:
        """Read `mirrors/*.dxf` and `assembly.glb` of a folder, and the STL files of the parts."""
        printed = [part for part in parts if part.name not in UNMOUNTED]
        sheets = sorted((folder / "mirrors").glob("mirrors*.dxf"))
        outlines = mirror_fits(read_cuts(sheets)[0], device.layout, device.hardware.cutting)
        assembly = read_glb(folder / ASSEMBLY)
        solids = {part.name: solid_of(read_stl(part.stl)) for part in printed}
        solids |= {f"mirror_{name}": solid for name, solid in mirrors_as_cut(outlines, device.layout).items()}
        solids |= {name: solid_of(mesh) for name, mesh in assembly.items() if name not in solids}
        return cls(device, printed, sheets, outlines, assembly, solids)

    @cached_property
    def valid(self) -> dict[str, manifold3d.Manifold]:
        """The solids that are valid."""
        return {name: solid for name, solid in self.solids.items() if is_manifold(solid)}

    @cached_property
    def valid_parts(self) -> dict[str, manifold3d.Manifold]:
        """The printed parts whose solids are valid."""
        return {part.name: self.valid[part.name] for part in self.printed if part.name in self.valid}

    @cached_property
    def mirrors(self) -> list[manifold3d.Manifold | None]:
        """The mirrors in the layout's order, None for a missing one."""
        return [self.valid.get(f"mirror_{name}") for name in self.device.layout.mirror_names]


def check_device(device: Device, parts: Sequence[BuiltPart], folder: Path) -> dict[str, Metric]:
    """Check the device in the folder of a build.

    Parameters
    ----------
    device : Device
        The plans of its parts.
    parts : sequence of BuiltPart
        Its printed parts, with their STEP and STL files.
    folder : Path
        Folder with `mirrors/*.dxf` and `assembly.glb`.

    Returns
    -------
    dict of str to Metric
        Checks and figures by name: `device.NAME`, `mirrors.NAME` or `PIECE.NAME`. Parts are as printed, mirrors as cut,
        camera and fasteners as in the assembly, and the device's support as in the plan of the adapter.
    """
    made, hardware = DeviceAsMade.read(device, parts, folder), device.hardware
    items, total = purchased_items(device), assembly_mass(hardware, made.assembly, parts)
    supports = supports_of(device, {name: made.valid[name] for name in item_names(items) if name in made.valid})
    return {
        **_check_pieces(made, parts),
        **check_mass(total),
        **check_back(device.back, items, made.valid, total),
        **check_aim(device.back, device.layout, hardware),
        **_check_stiffness(device),
        **check_nest(device.clip, device.layout, hardware),
        **check_rest(made.valid.get(CLIP), made.valid.get(CAMERA), hardware),
        **{f"mirrors.{name}": check for name, check in _check_mirrors(made).items()},
        **check_light(device.layout, hardware, made.valid_parts | supports, made.mirrors, made.valid.get(CAMERA)),
        **_check_stray_light(made),
        **_check_cover(made, parts),
        **check_surrounding_light(device.layout, made.valid),
        **check_clashes(
            made.valid | supports, hardware.fit.press_mm, supports, behind_mirrors_mm=hardware.holder.on_pads_mm
        ),
        **check_insertion(items, made.valid),
        **check_tool_reach(items, made.valid),
        **check_adjustment(device, made.valid, supports),
        **check_step_views(device.layout, items, made.valid),
    }


def _check_pieces(made: DeviceAsMade, parts: Sequence[BuiltPart]) -> dict[str, Metric]:
    """Check that the assembly has exactly the expected pieces, as valid meshes, and count the sliced parts."""
    expected = _expected_names(made.device, made.printed)
    return {
        "device.pieces_amiss": Metric(value=len(expected ^ set(made.assembly)), unit="", limit=0),
        "device.parts_sliced": Metric(value=sum("slices" in part.checks for part in parts), unit=f"of {len(parts)}"),
        "device.meshes_broken": Metric(value=len(made.solids) - len(made.valid), unit="", limit=0),
    }


def _check_stiffness(device: Device) -> dict[str, Metric]:
    """Largest rotation and displacement of the mirrors when gravity bends the mount, from the plan."""
    mount, limit = device.mount, device.hardware.mount.tilt_deg
    return {
        "mount.tilt_deg": Metric(value=round(mount.tilt_deg, 4), unit="deg", limit=limit),
        "mount.shift_um": Metric(value=round(mount.shift_um, 1), unit="um"),
    }


def _check_mirrors(made: DeviceAsMade) -> dict[str, Metric]:
    """Check the mirrors as cut, their seats, and their paths to the seats."""
    layout, hardware = made.device.layout, made.device.hardware
    seat_prefix = CARRIER if made.device.mirror_carriers else HOLDER
    holders = (part for part in made.printed if part.name.startswith(seat_prefix))
    faces = flat_faces(import_step(part.step) for part in holders)
    return {
        **check_cuts(made.sheets, layout, hardware.cutting),
        **check_seats(faces, layout, hardware, made.device.holder.planned_cover),
        **check_tape(layout, made.device.holder, hardware),
        **check_drop(made.outlines, layout, list(made.valid_parts.values()), hardware.fit.free_mm),
    }


def _check_stray_light(made: DeviceAsMade) -> dict[str, Metric]:
    parts = manifold3d.Manifold.compose(list(made.valid_parts.values()))
    fraction = stray_light(made.device.layout, parts, [solid for solid in made.mirrors if solid is not None])
    return {"device.stray_light": Metric(value=fraction, unit="of the pixels", limit=MAX_STRAY_LIGHT)}


def _check_cover(made: DeviceAsMade, parts: Sequence[BuiltPart]) -> dict[str, Metric]:
    """Check the dust cover, if the device has one, against all other pieces."""
    covers = [solid_of(read_stl(part.stl)) for part in parts if part.name == COVER]
    plan = made.device.cover
    return check_cover(plan, covers[0], made.valid) if plan and covers else {}


def supports_of(
    device: Device, fasteners: Mapping[str, manifold3d.Manifold] = MappingProxyType({})
) -> dict[str, manifold3d.Manifold]:
    """Solids outside the device that support it, by name, in the rig frame, with holes for the fasteners."""
    holes = manifold3d.Manifold.compose(list(fasteners.values()))
    return {
        support.name: manifold3d.Manifold.batch_boolean(
            [manifold3d.Manifold.hull_points(np.vstack([solid.base, solid.top])) for solid in support.solids],
            manifold3d.OpType.Add,
        )
        - holes
        for support in device.back.supports
    }


def _expected_names(device: Device, printed: Sequence[BuiltPart]) -> set[str]:
    """The expected names of the assembly's pieces."""
    counts: Counter[str] = Counter()
    names = {*(part.name for part in printed), *(f"mirror_{name}" for name in device.layout.mirror_names), CAMERA}
    for item in purchased_items(device):
        counts[item.kind] += 1
        kind = FORMING if item.size.endswith(" thread-forming") else IN_CAMERA if CAMERA in item.joins else item.kind
        names.add(f"{kind}_{counts[item.kind]:02d}")
    return names


def assembly_mass(
    hardware: Hardware, assembly: Mapping[str, trimesh.Trimesh], printed: Sequence[BuiltPart]
) -> MassProperties:
    """Mass properties of the assembly as one body, with its parts as printed."""
    plastic_g = {part.name: part.mass.mass_g for part in printed}
    bodies = []
    density: float
    for name, mesh in assembly.items():
        if name == CAMERA:
            density = hardware.camera.mass_g / (mesh.volume / 1000.0)
        elif is_mirror(name):
            density = MIRROR_DENSITIES[hardware.cutting.material]
        elif name.startswith(FASTENERS):
            density = BRASS_DENSITY if name.startswith("insert") else STEEL_DENSITY
        else:
            solid_g = hardware.printer.plastic_g_per_cm3 * mesh.volume / 1000.0  # of a piece that should not be there
            density = plastic_g.get(name, solid_g) / (mesh.volume / 1000.0)
        bodies.append(mass_of(mesh, density))
    return combined(bodies)


def check_mass(total: MassProperties) -> dict[str, Metric]:
    """Mass of the assembly, and its centre of mass in the rig frame."""
    return {
        "device.mass_g": Metric(value=round(total.mass_g, 2), unit="g"),
        **{
            f"device.centre_{axis}_mm": Metric(value=round(float(centre), 2), unit="mm")
            for axis, centre in zip("xyz", total.centre_in_rig_mm, strict=True)
        },
    }


def read_glb(path: Path) -> dict[str, trimesh.Trimesh]:
    """The pieces of a GLB file by name, in the rig frame (that of its node `device`), mm, whatever the file's unit."""
    scene = trimesh.load_scene(path)
    rig_from_file = np.linalg.inv(scene.graph.get("device")[0])
    meshes = {}
    for name in scene.graph.nodes_geometry:
        file_from_piece, geometry = scene.graph.get(name)
        mesh = scene.geometry[geometry].copy()
        mesh.apply_transform(rig_from_file @ file_from_piece)
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        meshes[name] = mesh
    return meshes


def check_drop(
    outlines: Mapping[str, OutlineFit], layout: Layout, parts: Sequence[manifold3d.Manifold], clearance_mm: float
) -> dict[str, Metric]:
    """Check that the mirrors, as cut, reach their seats along the normal with the stated clearance around them.

    Reports the overlap of parts with the mirrors' paths, and with the mirrors enlarged by the clearance.
    """
    printed = manifold3d.Manifold.compose(list(parts))
    in_path = in_clearance = 0.0
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        if name not in outlines:
            continue
        corners, thickness = outlines[name].corners, mirror.thickness_mm
        seat_mm = mirror.back_mm + ROUNDING_MM
        enlarged = np.array(Polygon(corners).buffer(clearance_mm - ROUNDING_MM).exterior.coords)
        in_path += overlap_mm3(printed, prism(mirror, corners, seat_mm, seat_mm + DROP_HEIGHT_RATIO * thickness))
        in_clearance += overlap_mm3(printed, prism(mirror, enlarged, seat_mm, seat_mm + thickness))
    return {
        "drop_clash_mm3": Metric(value=in_path, unit="mm3", limit=0.0),
        "room_clash_mm3": Metric(value=in_clearance, unit="mm3", limit=0.0),
        "room_mm": Metric(value=clearance_mm, unit="mm"),
    }
