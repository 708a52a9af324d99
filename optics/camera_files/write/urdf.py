"""URDF: the base camera and, fixed to it, the optical frame of every calibrated view, in metres.

Optical frames have x right, y down and z forward (REP 103); that of the base camera is the rig frame.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.number_text import numbers
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write.ros import frame_id
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera
from mirrorcam.optics.geometry.transforms import inverse

ROOT = "mirrorcam_camera_link"
CAMERA = "mirrorcam_camera_optical_frame"
LINK_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""A camera's body has x forward, y left and z up (REP 103)."""


def urdf(views: tuple[VirtualCamera, ...]) -> str:
    """The frames as a robot of links without bodies."""
    robot = Element("robot", name="mirrorcam_calibrated")
    SubElement(robot, "link", name=ROOT)
    _frame(robot, CAMERA, ROOT, LINK_FROM_OPTICAL)
    for view in views:
        _frame(robot, frame_id(view), CAMERA, inverse(view.camera_from_rig))
    indent(robot)
    return f'<?xml version="1.0"?>\n{tostring(robot, encoding="unicode")}\n'


def _frame(robot: Element, name: str, parent: str, parent_from_frame: FloatArray) -> None:
    """A link and its fixed joint; rpy turns about the fixed x, y and z."""
    SubElement(robot, "link", name=name)
    joint = SubElement(robot, "joint", name=f"{name}_joint", type="fixed")
    turns = Rotation.from_matrix(parent_from_frame[:3, :3]).as_euler("xyz")
    SubElement(joint, "origin", xyz=numbers(parent_from_frame[:3, 3] / 1000.0, " "), rpy=numbers(turns, " "))
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=name)
