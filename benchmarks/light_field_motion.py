"""The motion of a camera past a still scene, beside OpenCV's: `python -m benchmarks.light_field_motion [--json FILE]`.

A grid of 3x3 pinholes moves past rendered reliefs with cards before them, on a loop and along a line that leaves the
first picture behind, in good light and in little. Prints of each path the drift (how far the last pose is off, in parts
of the path), the root mean square error of all positions, NEES (the squared error by the covariance, over its six
degrees of freedom: 1 for a covariance that is true), key frames, lost frames, processor time of a frame, and frames per
second. The peer takes the same ORB keypoints of the central view, depth by StereoSGBM of the widest pair of the row,
and solvePnPRansac with refinement from frame to frame. TUM files of both go to --out. With --mirrors, the same paths
are filmed by the mirror camera: each pixel's ray goes by its mirror to the scene, and frames are decoded.
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
class Filmed:
    """Light fields from true poses world_from_view, the world being the first one's view frame."""

    name: str
    light_fields: list[LightField]
    poses: list[FloatArray]


def loop(frames: int) -> list[FloatArray]:
    """Poses on a loop past the scene, which all of them see."""
    poses = []
    for u in np.linspace(0.0, 1.0, frames):
        turn = [-14 * np.sin(1.4 * np.pi * u), 5 * np.sin(2 * np.pi * u), 12 * u]
        place = [150 * np.sin(1.4 * np.pi * u), 60 * np.sin(2 * np.pi * u), 70 * u * np.sin(3 * u)]
        poses.append(rigid(Rotation.from_euler("yxz", turn, degrees=True).as_matrix(), place))
    return poses


def line(frames: int) -> list[FloatArray]:
    """Poses along the scene, of which the last see nothing that the first saw."""
    poses = []
    for u in np.linspace(0.0, 1.0, frames):
        turn = [6 * np.sin(5 * u), 4 * np.sin(3 * u), 5 * np.sin(4 * u)]
        place = [700 * u, 40 * np.sin(4 * u), 30 * np.sin(6 * u)]
        poses.append(rigid(Rotation.from_euler("yxz", turn, degrees=True).as_matrix(), place))
    return poses


def scene_of(seed: int) -> Relief:
    return Relief(
        seed=seed,
        slants=(0.0, -0.2),
        cards=(Card(400.0, (-80.0, -50.0, -30.0, 10.0)), Card(430.0, (140.0, 20.0, 190.0, 60.0))),
    )


def film(name: str, path: list[FloatArray], views: Views, seed: int, noise_grey: float) -> Filmed:
    scene = scene_of(seed)
    first = inverse(path[0])
    poses = [first @ pose for pose in path]
    light_fields = [
        light_field_of(
            scene, views, noise_grey=noise_grey, world_from_view=pose, seed=1000 * seed + number, subsamples=1
        )[0]
        for number, pose in enumerate(poses)
    ]
    return Filmed(name, light_fields, poses)


def film_by_mirrors(name: str, path: list[FloatArray], layout: Layout, seed: int, noise_grey: float) -> Filmed:
    """Light fields decoded from frames of the mirror camera, whose reference view has the poses."""
    scene, decoder, first = scene_of(seed), Decoder(layout), inverse(path[0])
    poses, light_fields = [first @ pose for pose in path], []
    origin = decoder.views.reference_view_in_rig_mm @ layout.view_from_rig.T
    for number, pose in enumerate(poses):
        grey = np.zeros((layout.camera.height_px, layout.camera.width_px))
        for hit, start, turned in reflected_rays(layout):
            at = (start - origin) @ pose[:3, :3].T + pose[:3, 3]
            grey[hit] = scene.seen(at, turned @ pose[:3, :3].T)[0]
        grey += np.random.default_rng(1000 * seed + number).normal(0.0, noise_grey, grey.shape)
        frame = np.repeat(np.rint(np.clip(grey, 0.0, 255.0)).astype(np.uint8)[..., None], 3, axis=-1)
        light_fields.append(decoder.decode(frame))
    return Filmed(name, light_fields, poses)


def tracked(filmed: Filmed) -> tuple[list[TrackedPose], float]:
    """Poses of the tracker, and its processor time of a frame, s."""
    tracker = LightFieldTracker(filmed.light_fields[0])
    start = time.process_time()
    poses = [tracker.track(each) for each in filmed.light_fields]
    return poses, (time.process_time() - start) / len(poses)


def opencv_chain(filmed: Filmed) -> tuple[list[FloatArray], float]:
    """Poses by solvePnPRansac from frame to frame, with the depth of the frame before by StereoSGBM."""
    views = filmed.light_fields[0]
    middle, end = (views.rows // 2) * views.cols + views.cols // 2, (views.rows // 2 + 1) * views.cols - 1
    matrix = np.array([[views.focal_px, 0, views.centre_px[0]], [0, views.focal_px, views.centre_px[1]], [0, 0, 1.0]])
    baseline_mm = views.positions_mm.reshape(-1, 3)[end, 0]
    orb, matcher = cv2.ORB.create(1500, fastThreshold=7), cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    sgbm = cv2.StereoSGBM.create(-16, 32, 5, 200, 800, uniquenessRatio=10, mode=cv2.STEREO_SGBM_MODE_HH)
    poses, before = [np.eye(4)], None
    start = time.process_time()
    for light_field in filmed.light_fields:
        images = grey_views(light_field)
        found, descriptors = orb.detectAndCompute(images[middle], None)
        pixels = np.array([point.pt for point in found])
        if before is not None:
            matches = matcher.match(before[1], descriptors)
            first, second = np.array([(match.queryIdx, match.trainIdx) for match in matches]).T
            known = np.isfinite(before[2][first]).all(axis=1)
            points, seen = before[2][first[known]], pixels[second[known]]
            ok, turn, shift, inliers = cv2.solvePnPRansac(
                points, seen, matrix, None, reprojectionError=1.0, iterationsCount=300
            )
            if ok:
                chosen = inliers.ravel()
                turn, shift = cv2.solvePnPRefineLM(points[chosen], seen[chosen], matrix, None, turn, shift)
                poses.append(poses[-1] @ inverse(rigid(cv2.Rodrigues(turn)[0], shift.ravel())))
            else:
                poses.append(poses[-1])
        # Views are shifted so that the reference plane has no disparity: SGBM matches to either side of it.
        disparity = sgbm.compute(images[middle], images[end]) / 16.0
        u, v = np.rint(pixels).astype(int).T
        per_mm = np.where(disparity[v, u] > -17, disparity[v, u], np.nan) / (views.focal_px * baseline_mm)
        distance = 1.0 / (per_mm + 1.0 / views.reference_distance_mm)
        before = (
            found,
            descriptors,
            np.c_[(pixels - views.centre_px) / views.focal_px, np.ones(len(pixels))] * distance[:, None],
        )
    return poses, (time.process_time() - start) / len(poses)


def error(estimated: FloatArray, true: FloatArray) -> FloatArray:
    """xi (6,), mm and radians, with true = estimated exp(xi) to first order."""
    off = inverse(estimated) @ true
    return np.concatenate([off[:3, 3], Rotation.from_matrix(off[:3, :3]).as_rotvec()])


def nees(filmed: Filmed, poses: list[TrackedPose]) -> FloatArray:
    """Squared errors by the covariances over the degrees of freedom, of all poses but the first."""
    errors = [(error(pose.world_from_view, true), pose) for pose, true in zip(poses, filmed.poses, strict=True)][1:]
    return np.array([off @ np.linalg.solve(pose.covariance, off) / 6.0 for off, pose in errors if not pose.is_lost])


def length_mm(poses: list[FloatArray]) -> float:
    return float(sum(np.linalg.norm(two[:3, 3] - one[:3, 3]) for one, two in itertools.pairwise(poses)))


def _off_mm(poses: list[FloatArray], filmed: Filmed) -> FloatArray:
    """How far (n,) positions are off."""
    return np.array([np.linalg.norm(one[:3, 3] - true[:3, 3]) for one, true in zip(poses, filmed.poses, strict=True)])


def sequences(seeds: int, frames: int, layout: Layout | None = None) -> Iterator[Filmed]:
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
class Sums:
    """What is told of a sequence."""

    path_mm: float
    drift_percent: float
    rms_mm: float
    nees: float
    keys: int
    opencv_drift_percent: float
    opencv_rms_mm: float


def by_kind(sums: dict[str, list[Sums]]) -> Table:
    """A row for each kind of sequence, with the figures of all its scenes; once where all are alike."""

    def of(each: list[Sums], name: str, digits: int) -> str:
        texts = [f"{getattr(one, name):.{digits}f}" for one in each]
        return texts[0] if len(set(texts)) == 1 else ", ".join(texts)

    rows = [
        (
            kind,
            f"{of(each, 'path_mm', 0)} mm",
            f"{of(each, 'drift_percent', 3)} %",
            f"{of(each, 'rms_mm', 2)} mm",
            of(each, "nees", 2),
            of(each, "keys", 0),
            f"{of(each, 'opencv_drift_percent', 1)} %; {of(each, 'opencv_rms_mm', 0)} mm",
        )
        for kind, each in sums.items()
    ]
    return table(("", "path", "drift", "RMS error", "NEES", "key frames", "OpenCV: drift, RMS"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="scenes of each kind")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("output/motion"))
    parser.add_argument("--mirrors", action="store_true", help="frames of the mirror camera, decoded")
    add_json_option(parser)
    given = parser.parse_args()
    columns = ("", "path", "drift", "RMS error", "NEES", "key frames", "lost", "OpenCV: drift", "RMS error")
    rows, times = Rows(*columns), []
    given.out.mkdir(parents=True, exist_ok=True)
    all_nees, sums = [], dict[str, list[Sums]]()
    for filmed in sequences(given.seeds, given.frames, Layout.load(LAYOUT) if given.mirrors else None):
        start = time.perf_counter()
        poses, cpu_s = tracked(filmed)
        rate = len(poses) / (time.perf_counter() - start)
        path_mm = length_mm(filmed.poses)
        off = _off_mm([pose.world_from_view for pose in poses], filmed)
        other, other_s = opencv_chain(filmed)
        other_off = _off_mm(other, filmed)
        all_nees.append(nees(filmed, poses))
        keys, lost = sum(pose.is_key for pose in poses), sum(pose.is_lost for pose in poses)
        rows.add(
            *(filmed.name, f"{path_mm:.0f} mm", f"{100 * off[-1] / path_mm:.3f} %"),
            *(f"{np.sqrt(np.nanmean(off**2)):.2f} mm", f"{all_nees[-1].mean():.2f}", f"{keys}", f"{lost}"),
            *(f"{100 * other_off[-1] / path_mm:.1f} %", f"{np.sqrt(np.mean(other_off**2)):.0f} mm"),
        )
        sums.setdefault(filmed.name.rpartition(" ")[0], []).append(
            Sums(
                path_mm=path_mm,
                drift_percent=float(100 * off[-1] / path_mm),
                rms_mm=float(np.sqrt(np.nanmean(off**2))),
                nees=float(all_nees[-1].mean()),
                keys=keys,
                opencv_drift_percent=float(100 * other_off[-1] / path_mm),
                opencv_rms_mm=float(np.sqrt(np.mean(other_off**2))),
            )
        )
        times.append(f"{filmed.name}: {1e3 * cpu_s:.0f} ms, {rate:.1f} frames/s; OpenCV {1e3 * other_s:.0f} ms")
        name = filmed.name.replace(", ", "_").replace(" ", "_")
        times_s = (np.arange(len(poses)) / HZ).tolist()
        save_tum(given.out / f"{name}.tum", times_s, poses)
        truth = [TrackedPose(pose, np.zeros((6, 6)), 1, False) for pose in filmed.poses]
        save_tum(given.out / f"{name}_truth.tum", times_s, truth)
    print("\n".join(["Processor time of a frame:", *times]))
    nees_of_all = float(np.concatenate(all_nees).mean())
    print(f"NEES of all: {nees_of_all:.2f}")
    if given.mirrors:
        write_record(given.json, "light_field_motion_mirrors", {"nees": nees_of_all}, rows.table)
    else:
        write_record(given.json, "light_field_motion", {"nees": nees_of_all}, by_kind(sums))


if __name__ == "__main__":
    main()
