"""Camera motion past a static scene, against OpenCV's: `python -m benchmarks.light_field_motion [--json FILE]`.

A grid of 3x3 pinholes moves past rendered reliefs with cards in front of them, on a loop and along a line that leaves
the first picture behind, in good light and in little. Prints for each path the drift (the error of the last position,
relative to the path), the RMS error of all positions, NEES (the squared error in units of the covariance, per degree of
freedom: 1 for a correct covariance), key frames, lost frames, processor time of a frame, and frames per second. The
peer uses the same ORB keypoints of the central view, depth by StereoSGBM of the widest pair of the row, and
solvePnPRansac with refinement from frame to frame. TUM files of both are written to --out. With --mirrors, the same
paths are filmed by the mirror camera: each pixel's ray reaches the scene via its mirror, and frames are decoded.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.records import Rows, Table, add_json_option, table, write_record
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import inverse, rigid
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.features.keypoints import grey_views
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.motion import LightFieldTracker, TrackedPose, save_tum
from tests.optics.light_field.photographs import reflected_rays
from tests.optics.light_field.relief_scene import Card, Relief, even_views, light_field_of

STEP_MM = 10.0
HZ = 30.0
LAYOUT = Path("tests/data/fold_90_layout.json")


@dataclass(frozen=True)
class Sequence:
    """Light fields from true poses world_from_view; the world is the view frame of the first."""

    name: str
    light_fields: list[LightField]
    poses: list[FloatArray]


def loop(frames: int) -> list[FloatArray]:
    """Return poses on a loop past the scene, all of which see it."""
    poses = []
    for u in np.linspace(0.0, 1.0, frames):
        angles_deg = [-14 * np.sin(1.4 * np.pi * u), 5 * np.sin(2 * np.pi * u), 12 * u]
        position = [150 * np.sin(1.4 * np.pi * u), 60 * np.sin(2 * np.pi * u), 70 * u * np.sin(3 * u)]
        poses.append(rigid(Rotation.from_euler("yxz", angles_deg, degrees=True).as_matrix(), position))
    return poses


def line(frames: int) -> list[FloatArray]:
    """Return poses along the scene, the last of which see nothing that the first saw."""
    poses = []
    for u in np.linspace(0.0, 1.0, frames):
        angles_deg = [6 * np.sin(5 * u), 4 * np.sin(3 * u), 5 * np.sin(4 * u)]
        position = [700 * u, 40 * np.sin(4 * u), 30 * np.sin(6 * u)]
        poses.append(rigid(Rotation.from_euler("yxz", angles_deg, degrees=True).as_matrix(), position))
    return poses


def scene_of(seed: int) -> Relief:
    return Relief(
        seed=seed,
        slants=(0.0, -0.2),
        cards=(Card(400.0, (-80.0, -50.0, -30.0, 10.0)), Card(430.0, (140.0, 20.0, 190.0, 60.0))),
    )


def film(name: str, path: list[FloatArray], views: Views, seed: int, noise_grey: float) -> Sequence:
    scene = scene_of(seed)
    first = inverse(path[0])
    poses = [first @ pose for pose in path]
    light_fields = [
        light_field_of(
            scene, views, noise_grey=noise_grey, world_from_view=pose, seed=1000 * seed + number, subsamples=1
        )[0]
        for number, pose in enumerate(poses)
    ]
    return Sequence(name, light_fields, poses)


def film_by_mirrors(name: str, path: list[FloatArray], layout: Layout, seed: int, noise_grey: float) -> Sequence:
    """Decode light fields from frames of the mirror camera, whose reference view has the poses."""
    scene, decoder, first = scene_of(seed), Decoder(layout), inverse(path[0])
    poses, light_fields = [first @ pose for pose in path], []
    origin = decoder.views.reference_view_in_rig_mm @ layout.view_from_rig.T
    for number, pose in enumerate(poses):
        grey = np.zeros((layout.camera.height_px, layout.camera.width_px))
        for hit, start, direction in reflected_rays(layout):
            world_start = (start - origin) @ pose[:3, :3].T + pose[:3, 3]
            grey[hit] = scene.seen(world_start, direction @ pose[:3, :3].T)[0]
        grey += np.random.default_rng(1000 * seed + number).normal(0.0, noise_grey, grey.shape)
        frame = np.repeat(np.rint(np.clip(grey, 0.0, 255.0)).astype(np.uint8)[..., None], 3, axis=-1)
        light_fields.append(decoder.decode(frame))
    return Sequence(name, light_fields, poses)


def track(sequence: Sequence) -> tuple[list[TrackedPose], float]:
    """Return the poses of the tracker, and its processor time per frame, s."""
    tracker = LightFieldTracker(sequence.light_fields[0])
    start = time.process_time()
    poses = [tracker.track(light_field) for light_field in sequence.light_fields]
    return poses, (time.process_time() - start) / len(poses)


def opencv_chain(sequence: Sequence) -> tuple[list[FloatArray], float]:
    """Return poses by solvePnPRansac from frame to frame, with the previous frame's depth by StereoSGBM."""
    views = sequence.light_fields[0]
    central, last = (views.rows // 2) * views.cols + views.cols // 2, (views.rows // 2 + 1) * views.cols - 1
    matrix = np.array([[views.focal_px, 0, views.centre_px[0]], [0, views.focal_px, views.centre_px[1]], [0, 0, 1.0]])
    baseline_mm = views.positions_mm.reshape(-1, 3)[last, 0]
    orb, matcher = cv2.ORB.create(1500, fastThreshold=7), cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    sgbm = cv2.StereoSGBM.create(-16, 32, 5, 200, 800, uniquenessRatio=10, mode=cv2.STEREO_SGBM_MODE_HH)
    poses, previous = [np.eye(4)], None
    start = time.process_time()
    for light_field in sequence.light_fields:
        images = grey_views(light_field)
        keypoints, descriptors = orb.detectAndCompute(images[central], None)
        pixels = np.array([point.pt for point in keypoints])
        if previous is not None:
            matches = matcher.match(previous[1], descriptors)
            first, second = np.array([(match.queryIdx, match.trainIdx) for match in matches]).T
            valid = np.isfinite(previous[2][first]).all(axis=1)
            points, observed = previous[2][first[valid]], pixels[second[valid]]
            ok, rotation, shift, inliers = cv2.solvePnPRansac(
                points, observed, matrix, None, reprojectionError=1.0, iterationsCount=300
            )
            if ok:
                chosen = inliers.ravel()
                rotation, shift = cv2.solvePnPRefineLM(points[chosen], observed[chosen], matrix, None, rotation, shift)
                poses.append(poses[-1] @ inverse(rigid(cv2.Rodrigues(rotation)[0], shift.ravel())))
            else:
                poses.append(poses[-1])
        # Views are shifted so that the reference plane has no disparity: SGBM matches to either side of it.
        disparity = sgbm.compute(images[central], images[last]) / 16.0
        u, v = np.rint(pixels).astype(int).T
        per_mm = np.where(disparity[v, u] > -17, disparity[v, u], np.nan) / (views.focal_px * baseline_mm)
        distance = 1.0 / (per_mm + 1.0 / views.reference_distance_mm)
        previous = (
            keypoints,
            descriptors,
            np.c_[(pixels - views.centre_px) / views.focal_px, np.ones(len(pixels))] * distance[:, None],
        )
    return poses, (time.process_time() - start) / len(poses)


def error(estimated: FloatArray, true: FloatArray) -> FloatArray:
    """Return xi (6,), mm and radians, with true = estimated exp(xi) to first order."""
    difference = inverse(estimated) @ true
    return np.concatenate([difference[:3, 3], Rotation.from_matrix(difference[:3, :3]).as_rotvec()])


def nees(sequence: Sequence, poses: list[TrackedPose]) -> FloatArray:
    """Return the squared errors in units of the covariances, per degree of freedom, of all poses but the first."""
    errors = [(error(pose.world_from_view, true), pose) for pose, true in zip(poses, sequence.poses, strict=True)][1:]
    return np.array([xi @ np.linalg.solve(pose.covariance, xi) / 6.0 for xi, pose in errors if not pose.is_lost])


def length_mm(poses: list[FloatArray]) -> float:
    return float(sum(np.linalg.norm(two[:3, 3] - one[:3, 3]) for one, two in itertools.pairwise(poses)))


def _errors_mm(poses: list[FloatArray], sequence: Sequence) -> FloatArray:
    """Return the errors (n,) of positions."""
    return np.array([np.linalg.norm(one[:3, 3] - true[:3, 3]) for one, true in zip(poses, sequence.poses, strict=True)])


def sequences(seeds: int, frames: int, layout: Layout | None = None) -> Iterator[Sequence]:
    views = even_views(3, STEP_MM)
    for title, path in (("loop", loop(frames)), ("line", line(frames))):
        for light, noise_grey in (("", 1.5), (", dim", 5.0)):
            for seed in range(seeds):
                name = f"{title}{light} {seed}"
                if layout is None:
                    yield film(name, path, views, seed, noise_grey)
                else:
                    yield film_by_mirrors(f"mirrors, {name}", path, layout, seed, noise_grey)


@dataclass(frozen=True)
class Figures:
    """The figures of a sequence."""

    path_mm: float
    drift_percent: float
    rms_mm: float
    nees: float
    keys: int
    opencv_drift_percent: float
    opencv_rms_mm: float


def by_kind(figures: dict[str, list[Figures]]) -> Table:
    """Return a row for each kind of sequence, with the figures of all its scenes, or one figure if all are equal."""

    def of(group: list[Figures], name: str, digits: int) -> str:
        texts = [f"{getattr(scene, name):.{digits}f}" for scene in group]
        return texts[0] if len(set(texts)) == 1 else ", ".join(texts)

    rows = [
        (
            kind,
            f"{of(group, 'path_mm', 0)} mm",
            f"{of(group, 'drift_percent', 3)} %",
            f"{of(group, 'rms_mm', 2)} mm",
            of(group, "nees", 2),
            of(group, "keys", 0),
            f"{of(group, 'opencv_drift_percent', 1)} %; {of(group, 'opencv_rms_mm', 0)} mm",
        )
        for kind, group in figures.items()
    ]
    return table(("", "path", "drift", "RMS error", "NEES", "key frames", "OpenCV: drift, RMS"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="scenes of each kind")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("output/motion"))
    parser.add_argument("--mirrors", action="store_true", help="frames of the mirror camera, decoded")
    add_json_option(parser)
    options = parser.parse_args()
    columns = ("", "path", "drift", "RMS error", "NEES", "key frames", "lost", "OpenCV: drift", "RMS error")
    rows, times = Rows(*columns), []
    options.out.mkdir(parents=True, exist_ok=True)
    all_nees, figures = [], dict[str, list[Figures]]()
    for sequence in sequences(options.seeds, options.frames, Layout.load(LAYOUT) if options.mirrors else None):
        start = time.perf_counter()
        poses, cpu_s = track(sequence)
        rate = len(poses) / (time.perf_counter() - start)
        path_mm = length_mm(sequence.poses)
        errors = _errors_mm([pose.world_from_view for pose in poses], sequence)
        opencv_poses, opencv_s = opencv_chain(sequence)
        opencv_errors = _errors_mm(opencv_poses, sequence)
        all_nees.append(nees(sequence, poses))
        keys, lost = sum(pose.is_key for pose in poses), sum(pose.is_lost for pose in poses)
        rows.add(
            *(sequence.name, f"{path_mm:.0f} mm", f"{100 * errors[-1] / path_mm:.3f} %"),
            *(f"{np.sqrt(np.nanmean(errors**2)):.2f} mm", f"{all_nees[-1].mean():.2f}", f"{keys}", f"{lost}"),
            *(f"{100 * opencv_errors[-1] / path_mm:.1f} %", f"{np.sqrt(np.mean(opencv_errors**2)):.0f} mm"),
        )
        figures.setdefault(sequence.name.rpartition(" ")[0], []).append(
            Figures(
                path_mm=path_mm,
                drift_percent=float(100 * errors[-1] / path_mm),
                rms_mm=float(np.sqrt(np.nanmean(errors**2))),
                nees=float(all_nees[-1].mean()),
                keys=keys,
                opencv_drift_percent=float(100 * opencv_errors[-1] / path_mm),
                opencv_rms_mm=float(np.sqrt(np.mean(opencv_errors**2))),
            )
        )
        times.append(f"{sequence.name}: {1e3 * cpu_s:.0f} ms, {rate:.1f} frames/s; OpenCV {1e3 * opencv_s:.0f} ms")
        name = sequence.name.replace(", ", "_").replace(" ", "_")
        times_s = (np.arange(len(poses)) / HZ).tolist()
        save_tum(options.out / f"{name}.tum", times_s, poses)
        truth = [TrackedPose(pose, np.zeros((6, 6)), 1, False) for pose in sequence.poses]
        save_tum(options.out / f"{name}_truth.tum", times_s, truth)
    print("\n".join(["Processor time of a frame:", *times]))
    mean_nees = float(np.concatenate(all_nees).mean())
    print(f"NEES of all: {mean_nees:.2f}")
    if options.mirrors:
        write_record(options.json, "light_field_motion_mirrors", {"nees": mean_nees}, rows.table)
    else:
        write_record(options.json, "light_field_motion", {"nees": mean_nees}, by_kind(figures))


if __name__ == "__main__":
    main()
