"""Bodies of a device (printed parts, camera, screws) in a scene, and ray casts of the ground truth against them.

Files are in the frame of the holder, which is the rig frame of the design, in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.disk.fingerprint import digest
from mirrorcam.core.disk.nested_text import json_value
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Matrix4, Value
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.mesh_shapes import read_mesh
from mirrorcam.render_scenes.reference.integrator import CLEARANCE_MM
from mirrorcam.render_scenes.reference.mirror_shapes import mesh

ASSEMBLY = "assembly.glb"
ROOT_NODE = "device"
UNMOUNTED = ("fit_coupon", "dust_cover")  # among the printed parts, but not in the assembled device
MATCH_TOLERANCE_MM = 0.05  # between mirror corners in a file and in a layout
# Dark, diffuse plastic if a file has no colour.
PLASTIC_RGB = (0.03, 0.03, 0.03)
_COMPONENTS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass(frozen=True, eq=False)
class DeviceBody:
    """A body: points (n, 3), mm, triangles (m, 3), normals (n, 3) or none, and linear RGB.

    `kind` is one of `mirrorcam cad`'s: part, mirror, camera, screw, insert, nut or pin.
    """

    name: str
    kind: str
    points: FloatArray
    faces: NDArray[np.int64]
    normals: FloatArray | None
    rgb: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Assembly:
    """An assembled device: its bodies in the rig frame, and the rotation (3, 3) to the axes in which it stands.

    These are x as in the rig frame, y level to the front, and z up.
    """

    bodies: tuple[DeviceBody, ...]
    stand_from_rig: FloatArray


class DeviceParts(Value):
    """The parts around the mirrors of a device: a folder of files, their common checksum, and the pose of the camera.

    `holder_from_rig` is the rigid transform from the camera's frame, rig as built, to the parts' frame, mm.
    """

    folder: str
    checksum: str
    holder_from_rig: Matrix4


def parts_of(folder: Path, nominal: Layout, built: Layout) -> DeviceParts:
    """Find the parts in a folder for the built version of a layout.

    Raises InputError if the folder has no parts, or parts of a different layout.
    """
    if (folder / ASSEMBLY).is_file():
        check_mirrors(folder, nominal)
    return DeviceParts(
        folder=str(folder.resolve()),
        checksum=checksum(folder),
        holder_from_rig=holder_from_rig(nominal, built),
    )


def check_mirrors(folder: Path, nominal: Layout) -> None:
    """Raise InputError if an assembly contains mirrors of a different layout."""
    mirrors = [body for body in read_assembly(folder / ASSEMBLY).bodies if body.kind == "mirror"]
    if not mirrors:
        return
    corners = cKDTree(np.concatenate([body.points for body in mirrors]))
    error_mm = max(float(corners.query(mirror.outline_in_rig_mm)[0].max()) for mirror in nominal.mirrors)
    if len(mirrors) != len(nominal.mirrors) or error_mm > MATCH_TOLERANCE_MM:
        raise InputError(
            f"{folder}: parts of a different layout, expected those that `mirrorcam cad` wrote for this one"
        )


def read_device(parts: DeviceParts) -> tuple[DeviceBody, ...]:
    """Read the bodies of a device, in the frame of its camera; raise InputError if files have changed."""
    folder = Path(parts.folder)
    if checksum(folder) != parts.checksum:
        raise InputError(f"{folder}: parts have changed since the set was started, expected the same files")
    return tuple(
        body if body.kind == "camera" else in_camera_frame(body, parts.holder_from_rig) for body in read_bodies(folder)
    )


def checksum(folder: Path) -> str:
    """Return the SHA-256 of the names and bytes of the files that `read_bodies` reads, in hexadecimal."""
    return digest(*(f"{path.name} {digest(read_bytes(path))} ".encode() for path in parts_files(folder)))


def parts_files(folder: Path) -> tuple[Path, ...]:
    """List the files that `read_bodies` reads: the assembly of a folder or, without one, its STL files by name.

    Raises InputError if there is neither.
    """
    if (folder / ASSEMBLY).is_file():
        return (folder / ASSEMBLY,)
    files = tuple(path for path in sorted(folder.glob("*.stl")) if path.stem not in UNMOUNTED)
    if not files:
        raise InputError(f"{folder}: no {ASSEMBLY} and no .stl files, expected a folder that `mirrorcam cad` wrote")
    return files


def read_bodies(folder: Path) -> tuple[DeviceBody, ...]:
    """Read all bodies but the mirrors from the assembly of `mirrorcam cad` or from STL files, in the holder's frame."""
    files = parts_files(folder)
    if files[0].name == ASSEMBLY:
        return tuple(body for body in read_assembly(files[0]).bodies if body.kind != "mirror")
    bodies = []
    for path in files:
        surface = read_mesh(path)
        bodies.append(DeviceBody(path.stem, "part", surface.points, surface.faces.astype(np.int64), None, PLASTIC_RGB))
    return tuple(bodies)


def read_assembly(path: Path) -> Assembly:
    """Read the node `device` of an `assembly.glb`, binary glTF 2.0; raise InputError if it is invalid."""
    raw = read_bytes(path)
    try:
        length = int.from_bytes(raw[12:16], "little")
        if raw[:4] != b"glTF" or raw[16:20] != b"JSON":
            raise ValueError("not a binary glTF")
        tree, data = json_value(raw[20 : 20 + length]), memoryview(raw)[28 + length :]
        root = next(node for node in tree["nodes"] if node["name"] == ROOT_NODE)
        bodies = tuple(_body(tree, data, tree["nodes"][child]) for child in root["children"])
        return Assembly(bodies, _stand_from_rig(root["matrix"]))
    except InputError as error:
        raise InputError(f"{path}: not an assembly of `mirrorcam cad`: {error}") from None
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, StopIteration) as error:
        reason = f"{type(error).__name__} {error}".strip()
        raise InputError(f"{path}: not an assembly of `mirrorcam cad`: {reason}") from None


def _stand_from_rig(matrix: list[float]) -> FloatArray:
    """The stand's axes (3, 3) from a node's matrix by columns to glTF's: x to the left, y up, z to the front."""
    left, up, front = np.array(matrix, dtype=np.float64).reshape(4, 4).T[:3, :3]
    axes = np.array([-left, front, up])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6):
        raise ValueError("the matrix of the device is not a rotation")
    return axes


def _body(tree: dict[str, Any], data: memoryview, node: dict[str, Any]) -> DeviceBody:
    (primitive,) = tree["meshes"][node["mesh"]]["primitives"]

    def read(number: int) -> NDArray[Any]:
        accessor = tree["accessors"][number]
        width, kind = _WIDTHS[accessor["type"]], np.dtype(_COMPONENTS[accessor["componentType"]])
        view = tree["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(data, kind, accessor["count"] * width, start).reshape(-1, width)

    material = tree["materials"][primitive["material"]]["pbrMetallicRoughness"]
    red, green, blue = material["baseColorFactor"][:3]
    points, faces = read(primitive["attributes"]["POSITION"]), read(primitive["indices"]).reshape(-1, 3)
    if not np.isfinite(points).all() or faces.max() >= len(points):
        raise ValueError(f"{node['name']} is not a mesh")
    normals = read(primitive["attributes"]["NORMAL"]).astype(np.float64)
    return DeviceBody(
        node["name"],
        node["extras"]["kind"],
        points.astype(np.float64),
        faces.astype(np.int64),
        normals,
        (red, green, blue),
    )


def in_camera_frame(body: DeviceBody, holder_from_rig: FloatArray) -> DeviceBody:
    """Transform a body from the frame of the holder to the frame of the camera."""
    rotation, origin = holder_from_rig[:3, :3], holder_from_rig[:3, 3]
    normals = None if body.normals is None else body.normals @ rotation
    return replace(body, points=(body.points - origin) @ rotation, normals=normals)


def holder_from_rig(nominal: Layout, built: Layout) -> FloatArray:
    """Estimate the rigid transform (4, 4) from the camera frame of a device as built to the frame of its holder, mm.

    As mirrors are perturbed along their normals (and rotated about their centroids), the components of centroids
    perpendicular to the normals determine the position of the pupil, by least squares.
    """
    rotation = nominal.view_from_rig.T @ built.view_from_rig
    rows, values = [], []
    for mirror, built_mirror in zip(nominal.mirrors, built.mirrors, strict=True):
        projector = np.eye(3) - np.outer(mirror.normal_in_rig, mirror.normal_in_rig)
        rows.append(projector)
        values.append(
            projector @ (mirror.outline_in_rig_mm.mean(axis=0) - rotation @ built_mirror.outline_in_rig_mm.mean(axis=0))
        )
    return rigid(rotation, np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0])


def near_mm(bodies: Sequence[DeviceBody]) -> float:
    """Return the z, mm, at which the camera's own body, which contains the pupil, ends; 0 without a body."""
    return max((float(body.points[:, 2].max()) + CLEARANCE_MM for body in bodies if body.kind == "camera"), default=0.0)


def body_shapes(bodies: Sequence[DeviceBody]) -> dict[str, Any]:
    """Return diffuse shapes of bodies for the current variant, by name."""
    return {
        f"body_{body.name}": mesh(
            body.name,
            body.points,
            body.faces,
            {
                "type": "twosided",
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(body.rgb)}},
            },
            body.normals,
        )
        for body in bodies
    }


class BodyObstacles:
    """`truth.light_rays.Obstacles` for bodies in the frame of the camera; Mitsuba's variant must be set."""

    def __init__(self, bodies: Sequence[DeviceBody]) -> None:
        import mitsuba as mi

        self._scene = mi.load_dict({"type": "scene", **body_shapes(bodies)})
        self._near_mm = near_mm(bodies)

    def distance_to_body_mm(self, start: FloatArray, direction: FloatArray) -> FloatArray:
        """Return the distance (...), mm, from points (..., 3) along unit vectors (..., 3) to the nearest body."""
        import drjit as dr
        import mitsuba as mi

        shape = np.shape(direction)[:-1]
        valid = (np.isfinite(start) & np.isfinite(direction)).all(axis=-1).ravel()
        inputs = [
            np.broadcast_to(values, (*shape, 3)).reshape(-1, 3)[valid].astype(np.float32)
            for values in (start, direction)
        ]
        if dr.is_jit_v(mi.Float):
            rays = mi.Ray3f(*(mi.Point3f(values.T) for values in inputs))
            distances = np.array(self._scene.ray_intersect_preliminary(rays).t, dtype=np.float64)
        else:
            pairs = zip(*(values.tolist() for values in inputs), strict=True)
            distances = np.array([self._scene.ray_intersect_preliminary(mi.Ray3f(*pair)).t for pair in pairs])
        result = np.full(valid.shape, np.nan)
        result[valid] = distances
        return result.reshape(shape)

    def distance_from_pupil_mm(self, rays: FloatArray) -> FloatArray:
        """Return the distance (...), mm, from the pupil along unit rays (..., 3) to the nearest body but the camera."""
        start = (self._near_mm / rays[..., 2])[..., None] * rays
        return np.asarray(np.linalg.norm(start, axis=-1) + self.distance_to_body_mm(start, rays))
