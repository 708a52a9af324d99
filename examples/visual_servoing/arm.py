"""Kinematics of the Kinova Gen3 with seven joints, with the device on its flange."""

import numpy as np
from scipy.spatial.transform import Rotation

# Denavit-Hartenberg parameters from the user guide: twist in degrees and offset along z in mm of each joint; all link
# lengths are 0, and joints 2 to 7 are turned by 180 degrees.
TWIST_DEG = np.array([180, 90, 90, 90, 90, 90, 90, 180])
OFFSET_MM = np.array([0.0, -284.8, -11.8, -420.8, -12.8, -314.3, 0.0, -167.4])
ZERO_DEG = np.array([0, 0, 180, 180, 180, 180, 180, 180])
LARGEST_DEG_PER_S = np.array([80, 80, 80, 80, 70, 70, 70])

# The views look along the flange's z, from a reference view 120 mm in front of it.
FLANGE_FROM_VIEW = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 120], [0, 0, 0, 1]])


def base_from_view(joints_deg):
    """Return the pose (4, 4) of the reference view, mm."""
    pose = np.eye(4)
    angles = np.deg2rad(ZERO_DEG + np.append(0.0, joints_deg))
    for angle, offset, twist in zip(angles, OFFSET_MM, np.deg2rad(TWIST_DEG), strict=True):
        link = np.eye(4)
        link[:3, :3] = (Rotation.from_euler("z", angle) * Rotation.from_euler("x", twist)).as_matrix()
        link[2, 3] = offset
        pose = pose @ link
    return pose @ FLANGE_FROM_VIEW


def joint_speeds(joints_deg, velocity):
    """Return the speeds (7,) in degrees/s that move the reference view with a velocity (6,), within the limits.

    The velocity is in the view's own axes, mm/s and rad/s; of all solutions, the slowest is returned.
    """
    pose, step = base_from_view(joints_deg), 1e-4
    columns = []
    for joint in np.eye(7):
        moved = np.linalg.inv(pose) @ base_from_view(joints_deg + step * joint)
        columns.append(np.append(moved[:3, 3], Rotation.from_matrix(moved[:3, :3]).as_rotvec()) / step)
    scale = np.array([1 / 400] * 3 + [1] * 3)  # 1 rad counts as much as 400 mm, the distance of the scene
    speeds = np.linalg.pinv(scale[:, None] * np.transpose(columns)) @ (scale * velocity)
    return speeds / max(1.0, float((np.abs(speeds) / LARGEST_DEG_PER_S).max()))
