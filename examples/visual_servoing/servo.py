"""Move a simulated robot arm to a taught view by 4-D features, and compare with one camera alone.

    python examples/visual_servoing/servo.py [OUT]

The arm (a Kinova Gen3) carries the device of mirrors on its flange. It is moved away from where the view was taught
and drives back by what it sees. All controllers use the same matches; only what they know of depth differs. Writes
OUT/convergence.png and OUT/convergence.csv.
"""

import csv
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import mirrorcam
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features import FeatureFinder, Features
from mirrorcam.optics.light_field.motion.servoing import Matches, interaction, match_features, servo_velocity
from mirrorcam.render_scenes.preview.preview_frame import SENSOR, arranged_tabletop, preview_of
from mirrorcam.render_scenes.preview.traced_scene import traced_tabletop

# Denavit-Hartenberg parameters from the user guide: twist in degrees and offset along z in mm of each joint; all link
# lengths are 0, and joints 2 to 7 are turned by 180 degrees.
TWIST_DEG = np.array([180, 90, 90, 90, 90, 90, 90, 180])
OFFSET_MM = np.array([0.0, -284.8, -11.8, -420.8, -12.8, -314.3, 0.0, -167.4])
ZERO_DEG = np.array([0, 0, 180, 180, 180, 180, 180, 180])
LARGEST_DEG_PER_S = np.array([80, 80, 80, 80, 70, 70, 70])

# The views look along the flange's z, from a reference view 120 mm in front of it.
FLANGE_FROM_VIEW = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 120], [0, 0, 0, 1]])


def base_from_view(joints_deg: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of the reference view, mm."""
    pose = np.eye(4)
    angles = np.deg2rad(ZERO_DEG + np.append(0.0, joints_deg))
    for angle, offset, twist in zip(angles, OFFSET_MM, np.deg2rad(TWIST_DEG), strict=True):
        link = np.eye(4)
        link[:3, :3] = (Rotation.from_euler("z", angle) * Rotation.from_euler("x", twist)).as_matrix()
        link[2, 3] = offset
        pose = pose @ link
    return np.asarray(pose @ FLANGE_FROM_VIEW)


def joint_speeds(joints_deg: FloatArray, velocity: FloatArray) -> FloatArray:
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
    return np.asarray(speeds / max(1.0, float((np.abs(speeds) / LARGEST_DEG_PER_S).max())))


# Joint angles at which the view was taught, and by which the arm is moved away.
TAUGHT_DEG = np.array([0.0, 15.0, 180.0, -130.0, 0.0, 55.0, 90.0])
MOVED_DEG = np.array([3.0, -2.0, -2.0, 3.0, 3.0, -4.0, 5.0])
PERIOD_S, GAIN_PER_S, STEPS = 0.4, 1.0, 24
CONTROLLERS: dict[str, Callable[[Matches], FloatArray]] = {
    "light field: 4-D features": lambda matches: servo_velocity(matches, GAIN_PER_S),
    "one camera, given every depth in the taught view": lambda matches: one_camera(matches, matches.taught[:, 2]),
    "one camera, given their median": lambda matches: one_camera(matches, np.median(matches.taught[:, 2])),
}


def one_camera(matches: Matches, inverse_distance: FloatArray | float) -> FloatArray:
    """Return the velocity by the directions of the features alone, with assumed inverse distances in 1/mm."""
    assumed = matches.current.copy()
    assumed[:, 2] = inverse_distance
    weights = 1.0 / matches.sigma[:, :2]
    rows = (weights[..., None] * interaction(assumed)[:, :2]).reshape(-1, 6)
    error = (weights * (matches.current - matches.taught)[:, :2]).ravel()
    scale = np.array([1.0 / np.median(assumed[:, 2])] * 3 + [1.0] * 3)
    solution = np.linalg.lstsq(rows * scale, error, rcond=None)[0]
    return np.asarray(-GAIN_PER_S * scale * solution)


def main(out: Path) -> None:
    layout = mirrorcam.design(mirrorcam.DesignSpec())
    scene, decoder = arranged_tabletop(layout, 0), mirrorcam.Decoder(layout)
    finder = FeatureFinder(decoder.views, "ORB", keypoints=1500)
    pupil_from_view = np.eye(4)  # the scene's origin is the pupil, the arm moves the reference view
    pupil_from_view[:3, 3] = decoder.views.view_from_rig @ decoder.views.reference_view_in_rig_mm
    taught_from_base = np.linalg.inv(base_from_view(TAUGHT_DEG))

    def features(joints_deg: FloatArray, seed: int) -> Features:
        """Return the features of the scene as the arm sees it."""
        moved = pupil_from_view @ taught_from_base @ base_from_view(joints_deg) @ np.linalg.inv(pupil_from_view)
        view_from_world = np.linalg.inv(moved)
        objects = tuple(
            item.replaced(view_from_object=view_from_world @ item.view_from_object) for item in scene.objects
        )
        lamp = view_from_world[:3, :3] @ scene.lamp_target_in_view_mm + view_from_world[:3, 3]
        seen = traced_tabletop(replace(scene, objects=objects, lamp_target_in_view_mm=lamp))
        return finder.find(decoder.decode(preview_of(seen, layout, SENSOR, seed).picture))

    taught, rows = features(TAUGHT_DEG, 0), []
    for name, velocity in CONTROLLERS.items():
        joints_deg = TAUGHT_DEG + MOVED_DEG
        for step in range(STEPS):
            apart = taught_from_base @ base_from_view(joints_deg)
            turn_deg = np.degrees(np.linalg.norm(Rotation.from_matrix(apart[:3, :3]).as_rotvec()))
            rows.append((name, step * PERIOD_S, float(np.linalg.norm(apart[:3, 3])), turn_deg))
            print(f"{name}: {rows[-1][1]:.1f} s, {rows[-1][2]:.2f} mm, {turn_deg:.3f} deg")
            matches = match_features(decoder.views, features(joints_deg, step + 1), taught)
            if matches is None:
                print(f"{name}: lost, it sees too little of the taught view")
                break
            joints_deg = joints_deg + PERIOD_S * joint_speeds(joints_deg, velocity(matches))
    out.mkdir(parents=True, exist_ok=True)
    with (out / "convergence.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("controller", "time_s", "distance_mm", "turn_deg"), *rows])
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.3), layout="constrained")
    for axis, column, label in zip(axes, (2, 3), ("distance in mm", "rotation in degrees"), strict=True):
        for name in CONTROLLERS:
            times, values = zip(*((row[1], row[column]) for row in rows if row[0] == name), strict=True)
            axis.semilogy(times, values, marker=".", label=name)
        axis.set(xlabel="time in s", ylabel=f"{label} from the taught view")
        axis.grid(alpha=0.3)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.savefig(out / "convergence.png", dpi=150)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "output/examples/visual_servoing"))
