"""Devices as built: layouts perturbed at random within tolerances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import stacked
from mirrorcam.optics.geometry.sub_images import covers_sensor, sub_image_polygons
from mirrorcam.optics.geometry.tolerances import WORKMANSHIP, Tolerances

DRAWS = 20  # attempts to sample mirrors that do not overlap in the image and a lens that covers the sensor


@dataclass(frozen=True)
class Perturbations:
    """Deviations of n devices with m mirrors from their design.

    Attributes
    ----------
    focal
        Relative error (n,) of the focal length.
    centre_px
        Error (n, 2) of the principal point.
    lens
        Error (n, 5) of k1 k2 p1 p2 k3.
    tilts_rad
        Rotation (n, m, 2) of each mirror about the x and y axis of its own plane.
    shifts_mm
        Shift (n, m) of each mirror along its normal.
    thickness_mm
        Error (n,) of the thickness of the sheet from which all mirrors of a device are cut.
    camera_shifts_mm
        Position (n, 3) of the pupil in the frame of the holder (the rig as designed).
    camera_rotations_rad
        Rotation vector (n, 3) of holder_from_camera.
    """

    focal: FloatArray
    centre_px: FloatArray
    lens: FloatArray
    tilts_rad: FloatArray
    shifts_mm: FloatArray
    thickness_mm: FloatArray
    camera_shifts_mm: FloatArray
    camera_rotations_rad: FloatArray


def draw_perturbations(
    tolerances: Tolerances, mirrors: int, devices: int, random: np.random.Generator
) -> Perturbations:
    """Sample devices from normal distributions.

    For one state of the generator, scaled tolerances give scaled samples, and the first devices do not depend on the
    number of devices.
    """
    # Thickness and camera have their own generator, so that the other samples do not depend on them.
    camera_draws = random.spawn(1)[0].standard_normal((devices, 7))
    draws = random.standard_normal((devices, 8 + 3 * mirrors))
    mirror_draws = draws[:, 8:].reshape(devices, mirrors, 3)
    return Perturbations(
        focal=tolerances.focal_percent / 100.0 * draws[:, 0],
        centre_px=tolerances.centre_px * draws[:, 1:3],
        lens=np.array(tolerances.distortion_mean) + np.array(tolerances.distortion_sigma) * draws[:, 3:8],
        tilts_rad=np.deg2rad(tolerances.tilt_deg) * mirror_draws[..., :2],
        shifts_mm=tolerances.offset_mm * mirror_draws[..., 2],
        thickness_mm=tolerances.sheet_thickness_mm * camera_draws[:, 0],
        camera_shifts_mm=tolerances.camera_offset_mm * camera_draws[:, 1:4],
        camera_rotations_rad=np.deg2rad(tolerances.camera_turn_deg) * camera_draws[:, 4:],
    )


def perturbed_camera(camera: Camera, perturbations: Perturbations, device: int) -> Camera:
    """The camera of one device; the same object if it is not perturbed."""
    focal, centre, lens = 1.0 + perturbations.focal[device], perturbations.centre_px[device], perturbations.lens[device]
    if focal == 1.0 and not centre.any() and not lens.any():
        return camera
    return camera.replaced(
        fx_px=camera.fx_px * focal,
        fy_px=camera.fy_px * focal,
        cx_px=camera.cx_px + centre[0],
        cy_px=camera.cy_px + centre[1],
        distortion=camera.lens.perturbed(lens).coefficients,
    )


@dataclass(frozen=True)
class Devices:
    """Mirrors and pupils of n devices in the frame of their holder, which is the rig frame as designed.

    Attributes
    ----------
    normals
        Unit normals (n, m, 3) on the reflecting side.
    centroids_mm
        Means (n, m, 3) of the outlines' corners, on the reflecting planes.
    axes
        The x and y axis (n, m, 3, 2) of each mirror's own frame.
    outlines_mm
        Corners (n, m, k, 3); mirrors with fewer than k repeat the last.
    thicknesses_mm
        Thicknesses (n, m) of the mirrors.
    pupils_mm
        Positions of the cameras' pupils (n, 3).
    holder_from_camera
        Rotations of the cameras (n, 3, 3).
    """

    normals: FloatArray
    centroids_mm: FloatArray
    axes: FloatArray
    outlines_mm: FloatArray
    thicknesses_mm: FloatArray
    pupils_mm: FloatArray
    holder_from_camera: FloatArray


def perturbed_mirrors(layout: Layout, perturbations: Perturbations) -> Devices:
    """Perturb the mirrors: tilt each about the centre of its outline, then shift it along its nominal normal.

    The back of a mirror rests on its seat. A thicker first-surface mirror therefore reflects nearer to the pupil; a
    thicker second-surface mirror reflects in the same plane, behind more glass.
    """
    shape = perturbations.shifts_mm.shape
    normals = np.array([mirror.normal_in_rig for mirror in layout.mirrors])
    frames = np.array([mirror.rig_from_plane for mirror in layout.mirrors])
    centroids = np.array([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors])
    from_centroid = stacked(
        [mirror.outline_in_rig_mm - mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors]
    )
    thicknesses = np.array([mirror.thickness_mm for mirror in layout.mirrors])
    is_raised = np.array([not mirror.is_second_surface for mirror in layout.mirrors])
    vectors = (frames[:, :3, :2] @ perturbations.tilts_rad[..., None])[..., 0]
    rotations = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(*shape, 3, 3)
    shifts = (perturbations.shifts_mm + np.where(is_raised, perturbations.thickness_mm[:, None], 0.0))[
        ..., None
    ] * normals
    return Devices(
        normals=(rotations @ normals[..., None])[..., 0],
        centroids_mm=centroids + shifts,
        axes=rotations @ frames[:, :3, :2],
        outlines_mm=from_centroid @ np.swapaxes(rotations, -1, -2) + centroids[:, None] + shifts[..., None, :],
        thicknesses_mm=thicknesses + perturbations.thickness_mm[:, None],
        pupils_mm=perturbations.camera_shifts_mm,
        holder_from_camera=Rotation.from_rotvec(perturbations.camera_rotations_rad).as_matrix(),
    )


def _built(layout: Layout, perturbations: Perturbations) -> Layout:
    """The first device as a layout in its own rig frame, the frame of its camera."""
    devices = perturbed_mirrors(layout, perturbations)
    rotation, pupil = devices.holder_from_camera[0], devices.pupils_mm[0]
    mirrors = tuple(
        Mirror.from_plane(
            (devices.centroids_mm[0, k] - pupil) @ rotation,
            devices.normals[0, k] @ rotation,
            outline_in_rig_mm=(devices.outlines_mm[0, k, : len(mirror.outline_in_rig_mm)] - pupil) @ rotation,
            surface=mirror.surface,
            thickness_mm=float(devices.thicknesses_mm[0, k]),
            refractive_index=mirror.refractive_index,
        )
        for k, mirror in enumerate(layout.mirrors)
    )
    return layout.replaced(
        kind="as-built",
        camera=perturbed_camera(layout.camera, perturbations, 0),
        mirrors=mirrors,
        view_from_rig=layout.view_from_rig @ rotation,
        metrics={},
        verdict={},
        provenance={"drawn_from": layout.identity},
        uncertainty=None,
    )


def draw_as_built(layout: Layout, tolerances: Tolerances, random: np.random.Generator) -> Layout:
    """Sample a device built from a layout; sample again (up to 20 times) if it is physically impossible.

    Parameters
    ----------
    layout : design with flat mirrors.
    tolerances : standard deviations.
    random : random generator.

    Returns
    -------
    A layout of kind "as-built" in the rig frame of the camera as it sits in the holder; the view axes remain the
    holder's.

    Raises
    ------
    InputError : all samples are impossible (the message names the tolerance), or a mirror is bent.
    """
    named = zip(layout.mirror_names, layout.mirrors, strict=True)
    if bent := [name for name, mirror in named if mirror.curvature_per_m.any()]:
        raise InputError(f"mirror {bent[0]} has a curvature_per_m, expected a design with flat mirrors")
    for _ in range(DRAWS):
        perturbations = draw_perturbations(tolerances, len(layout.mirrors), 1, random)
        try:
            built = _built(layout, perturbations)
        except InvalidValue as error:
            reason = f"{workmanship(tolerances)}: {error.reason}"
            if error.title == Camera.__name__:
                reason = f"focal_percent {tolerances.focal_percent}: {error.reason}"
            continue
        if not covers_sensor(built.camera):
            reason = (
                f"distortion_mean {list(tolerances.distortion_mean)}: the distortion is not monotonic on the sensor"
            )
        elif invisible := [k for k, sub_image in enumerate(sub_image_polygons(built)) if sub_image.is_empty]:
            reason = (
                f"{workmanship(tolerances)}, focal_percent {tolerances.focal_percent}, "
                f"centre_px {tolerances.centre_px}: mirror {built.mirror_names[invisible[0]]} lies outside the sensor"
            )
        else:
            return built
    raise InputError(f"tolerances {reason} (in each of {DRAWS} draws), reduce the tolerances")


def workmanship(tolerances: Tolerances) -> str:
    """The nonzero tolerances of printing and assembly, for an error message."""
    return ", ".join(f"{name} {value}" for name in WORKMANSHIP if (value := getattr(tolerances, name)) > 0)
