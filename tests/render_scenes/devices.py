"""Bodies of devices, their files and scenes, for tests."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.reference.device_bodies import DeviceBody
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings

SETTINGS = RenderSettings(sensor=SENSORS["ideal"])


def box(low: Sequence[float] | FloatArray, high: Sequence[float] | FloatArray, kind: str = "part") -> DeviceBody:
    """A box, its faces outwards, of a plastic that scatters a fifth of the light."""
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([[a, b, c] for a, b, c, _ in quads] + [[a, c, d] for a, _, c, d in quads])
    return DeviceBody("box", kind, corners, faces, None, (0.2, 0.2, 0.2))


def scene_of(
    layout: Layout, board: Charuco, pose: FloatArray, *bodies: DeviceBody, variant: str | None = None
) -> BoardScene:
    scene = BoardScene(layout.camera, layout.mirrors, board, SETTINGS, bodies=bodies, variant=variant)
    scene.place_board(pose)
    return scene


def write_stl(path: Path, body: DeviceBody) -> None:
    facets = np.zeros(len(body.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = body.points[body.faces]
    path.write_bytes(bytes(80) + len(facets).to_bytes(4, "little") + facets.tobytes())


def write_glb(path: Path, pieces: dict[str, tuple[str, DeviceBody]], stand_from_rig: FloatArray) -> None:
    """Binary glTF as `mirrorcam cad` writes it."""
    right, forward, up = stand_from_rig
    matrix = np.eye(4)
    matrix[:3, :3] = 0.001 * np.array([-right, up, forward])
    data, views, accessors = b"", [], []

    def add(values: Any, component: int, shape: str) -> int:
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        accessors.append(
            {"componentType": component, "type": shape, "bufferView": len(views) - 1, "count": len(values)}
        )
        data += values.tobytes()
        return len(views) - 1

    meshes, nodes = [], []
    for name, (kind, body) in pieces.items():
        corners = body.points[body.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        index = add(np.arange(3 * len(corners), dtype=np.uint32), 5125, "SCALAR")
        points = {"POSITION": add(np.float32(corners).reshape(-1, 3), 5126, "VEC3")}
        normals = {"NORMAL": add(np.float32(np.repeat(across, 3, axis=0)), 5126, "VEC3")}
        meshes.append({"primitives": [{"attributes": points | normals, "indices": index, "material": 0}]})
        nodes.append({"name": name, "mesh": len(meshes) - 1, "extras": {"kind": kind}})
    tree = {
        "nodes": [
            {"name": "device", "matrix": matrix.T.ravel().tolist(), "children": list(range(1, len(nodes) + 1))},
            *nodes,
        ],
        "meshes": meshes,
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.25, 0.5, 0.75, 1.0]}}],
        "accessors": accessors,
        "bufferViews": views,
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(data)
    head = b"glTF" + (2).to_bytes(4, "little") + length.to_bytes(4, "little")
    path.write_bytes(
        head + len(text).to_bytes(4, "little") + b"JSON" + text + len(data).to_bytes(4, "little") + b"BIN\0" + data
    )
