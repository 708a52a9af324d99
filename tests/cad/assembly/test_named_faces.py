"""Faces with names: those of the default device are in its STEP files, in the planes that the plans have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.named_faces import named_faces
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.write.test_face_names import named_planes

Built = tuple[Layout, Path, dict[str, Metric]]


def test_faces_of_the_default_device_are_in_its_files(built_default: Built, device: Device) -> None:
    for part in parts_of(device):
        planes = named_planes((built_default[1] / "parts" / f"{part.name}.step").read_text(encoding="utf-8"))
        by_name = {face.name: face for face in part.faces}
        for name, (point, normal) in planes.items():
            face = by_name[name] if name in by_name else by_name[name.rpartition("_")[0]]
            assert (point - face.point) @ face.normal == pytest.approx(0.0, abs=0.02)
            np.testing.assert_allclose(normal, face.normal, atol=1e-4)
        if part.name == "mirror_holder":
            pads = [name for name in planes if name.startswith("pad_")]
            assert len(pads) == 3 * len(device.layout.mirrors)
            assert {name for name in by_name if any(each.startswith(name) for each in planes)} == set(by_name)
        if part.name == "mount":
            assert {"joint_back", "joint_slide", "joint_foot"} <= {name.removesuffix("_1") for name in planes}


def test_a_piece_of_a_part_has_the_faces_of_the_whole(device: Device) -> None:
    assert [face.name for face in named_faces(device, "mount_2")] == [
        face.name for face in named_faces(device, "mount")
    ]
    assert named_faces(device, "fit_coupon") == ()
