"""The export folder: a layout in the formats of other tools, with matching pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import write_bytes, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import check_size, read_image, write_image
from mirrorcam.core.names import word
from mirrorcam.optics.camera_files.write.formats import (
    FORMATS,
    camchain_yaml,
    camera_info_yaml,
    opencv_yaml,
    rig_cameras,
    transforms_json,
    urdf,
)
from mirrorcam.optics.camera_files.write.pose_cameras import (
    FFMPEG,
    calibration_toml,
    pictures_table,
    pose_cameras,
    stereo_params,
)
from mirrorcam.optics.camera_files.write.virtual_cameras import (
    BARE,
    VirtualCamera,
    bare_camera,
    fitted_distances_mm,
    view_name,
    virtual_cameras,
)
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sfm_rigs import rig_config, sparse_model

PICTURE = "0000.png"
FILES = (
    *("README.md", "opencv.yaml", "kalibr_camchain.yaml", "mirrorcam_calibrated.urdf"),
    *("colmap/rig_config.json", "nerfstudio/transforms.json"),
    *("anipose/calibration.toml", "deeplabcut/camera_matrix/stereo_params.pickle"),
    *(f"colmap/sparse/{name}.txt" for name in ("cameras", "rigs", "frames", "images", "points3D")),
)
"""Exported files that describe all cameras."""
PLAIN_FILES = {
    "OpenCV": "opencv.yaml",
    "ROS": f"ros/{BARE}.yaml",
    "Kalibr": "kalibr_camchain.yaml",
    "Anipose": "anipose/calibration.toml",
}
"""Exported files of a camera without mirrors, by the tool that they are for."""


def picture_names(pictures: Sequence[Path]) -> list[str]:
    """Names of frames for COLMAP's files, without spaces; raises InputError for duplicates."""
    names = [word(f"{path.stem}.png") for path in pictures]
    if len(set(names)) < len(names):
        raise InputError(f"pictures share a name, expected distinct names: {', '.join(sorted(names))}")
    return names


def export_names(layout: Layout, pictures: Sequence[Path] = ()) -> tuple[str, ...]:
    """Names of all files that `write_exports` will write."""
    names, files = picture_names(pictures), list(FILES)
    for view in (view_name(*divmod(number, layout.cols)) for number in range(len(layout.mirrors))):
        files += [f"ros/{view}.yaml", f"nerfstudio/masks/{view}.png"]
        files += [f"colmap/masks/{view}/{name}.png" for name in names or [PICTURE]]
        files += [f"colmap/images/{view}/{name}" for name in names]
        files += [f"nerfstudio/images/{view}.png"] if names else []
    return tuple(files)


def write_exports(layout: Layout, folder: Path, pictures: Sequence[Path] = ()) -> None:
    """Export the layout for OpenCV, ROS, Kalibr, COLMAP, nerfstudio, URDF, Anipose and DeepLabCut, with a README.md.

    Parameters
    ----------
    layout : the layout to export.
    folder : the folder to write to.
    pictures : frames of this camera. COLMAP, which estimates the motion of the rig, gets all of them as frames of one
        rig; nerfstudio gets the first.

    Raises
    ------
    InputError : a mirror shows nothing, or a picture has a wrong size or the name of another.
    """
    views = virtual_cameras(layout)
    names = picture_names(pictures)
    colmap, nerfstudio = folder / "colmap", folder / "nerfstudio"
    write_text(folder / "opencv.yaml", opencv_yaml(views))
    write_text(folder / "kalibr_camchain.yaml", camchain_yaml(views))
    write_text(folder / "mirrorcam_calibrated.urdf", urdf(views))
    for view in views:
        write_text(folder / "ros" / f"{view.name}.yaml", camera_info_yaml(view))
    cropped = pose_cameras(layout, views)
    write_text(folder / "anipose" / "calibration.toml", calibration_toml(cropped))
    write_bytes(folder / "deeplabcut" / "camera_matrix" / "stereo_params.pickle", stereo_params(cropped))
    cameras = rig_cameras(views)
    write_text(colmap / "rig_config.json", rig_config(cameras, layout.central_index))
    for name, text in sparse_model(cameras, layout.central_index, (names or [PICTURE])[0]).items():
        write_text(colmap / "sparse" / name, text)
    write_text(nerfstudio / "transforms.json", transforms_json(views, layout.view_from_rig))
    for view in views:
        write_image(nerfstudio / "masks" / f"{view.name}.png", view.mask[view.sub_image.slices])
        for name in names or [PICTURE]:
            write_image(colmap / "masks" / view.name / f"{name}.png", view.mask)
    for index, (path, name) in enumerate(zip(pictures, names, strict=True)):
        frame = _frame(path, layout)
        for view in views:
            flipped = view.flipped(frame)
            masked = np.where(view.mask.reshape(*view.mask.shape, 1) > 0, flipped, 0).astype(np.uint8)
            write_image(colmap / "images" / view.name / name, masked)
            if index == 0:
                write_image(nerfstudio / "images" / f"{view.name}.png", flipped[view.sub_image.slices])
    write_text(folder / "README.md", readme(layout, views))


def write_plain_exports(camera: Camera, folder: Path) -> None:
    """Export a camera without mirrors for OpenCV, ROS, Kalibr and Anipose, with a README.md.

    Parameters
    ----------
    camera : the camera.
    folder : the folder to write to.
    """
    view = bare_camera(camera)
    write_text(folder / "opencv.yaml", opencv_yaml((view,)))
    write_text(folder / "kalibr_camchain.yaml", camchain_yaml((view,)))
    write_text(folder / "ros" / f"{view.name}.yaml", camera_info_yaml(view))
    anipose = pose_cameras(Layout.bare(camera), ())
    write_text(folder / "anipose" / "calibration.toml", calibration_toml(anipose))
    errors = {name: FORMATS[name].of(view).error_px for name in ("OpenCV", "ROS", "Kalibr")}
    errors["Anipose"] = anipose[0].error_px
    rows = "".join(f"| {name} | `{PLAIN_FILES[name]}` | {error:.2g} |\n" for name, error in errors.items())
    write_text(
        folder / "README.md",
        f"""# A camera for other tools

{camera.name}, {camera.width_px} x {camera.height_px} px; pixel (0, 0) is the centre of the top-left pixel.

A tool whose lens model lacks parameters of the one here ({camera.lens_model}) gets the nearest lens; the largest error
over the picture is stated. No file holds a pupil that moves with the angle.

| tool | file | error, px |
|---|---|---|
{rows}""",
    )


def _frame(path: Path, layout: Layout) -> NDArray[np.uint8]:
    frame = read_image(path)
    camera = layout.camera
    check_size(path, (frame.shape[1], frame.shape[0]), (camera.width_px, camera.height_px), "the layout's camera")
    return frame


def readme(layout: Layout, views: tuple[VirtualCamera, ...]) -> str:
    """Description of the exported files and their pictures."""
    flip = views[0].flip
    option = "hflip" if flip == "left-right" else "vflip"
    rows = ""
    for view in views:
        crop = view.sub_image
        errors_px = (view.pinhole_error_px, *(lens.of(view).error_px for lens in FORMATS.values()))
        errors = " | ".join(f"{error:.2g}" if error > 1e-6 else "0" for error in errors_px)
        rows += f"| {view.name} | {crop.x}, {crop.y} | {crop.width} x {crop.height} | {errors} |\n"
    depths = " to ".join(f"{mm:.4g}" for mm in fitted_distances_mm(layout))
    return f"""# A mirror camera for other tools

Layout {layout.identity}, camera {layout.camera.width_px} x {layout.camera.height_px} px.

Here each mirror is a separate camera. A mirror reverses the image, so the picture of each camera is the frame **flipped
{flip}** (`{FFMPEG} -vf {option}`): the files here are wrong for a frame that is not flipped.

| file | picture | pixel (0, 0) is | unit |
|---|---|---|---|
| `opencv.yaml` | entire flipped frame; `roi` is the view's part | the centre of the top-left pixel | mm |
| `ros/VIEW.yaml` | entire flipped frame, or only its `roi` as in CameraInfo | the centre of the top-left pixel | |
| `mirrorcam_calibrated.urdf` | | | m |
| `kalibr_camchain.yaml` | entire flipped frame, one topic for each view | the centre of the top-left pixel | m |
| `colmap/` | entire flipped frame in `images/VIEW/`, with `masks/` | the corner of the top-left pixel | m |
| `nerfstudio/` | flipped frame cropped to the view, in `images/` | the corner of the top-left pixel | m |
| `anipose/calibration.toml` | frame flipped, then cropped, by the table below | the centre of the top-left pixel | mm |
| `deeplabcut/camera_matrix/stereo_params.pickle` | the same | the centre of the top-left pixel | mm |

OpenCV: x_camera = R x_rig + T; the rig's origin is the pupil, x right, y down, z along the optical axis.
ROS: in the URDF, the parent of each `mirrorcam_VIEW_optical_frame` is `mirrorcam_camera_optical_frame`, the rig frame.
The driver must copy `frame_id` and `roi` of each file into its messages; ROS's parser ignores them.

COLMAP with fixed, calibrated cameras:

    mkdir points
    colmap feature_extractor --database_path database.db --image_path images --ImageReader.mask_path masks \\
        --ImageReader.single_camera_per_folder 1
    colmap rig_configurator --database_path database.db --rig_config_path rig_config.json
    colmap exhaustive_matcher --database_path database.db
    colmap point_triangulator --database_path database.db --image_path images --input_path sparse \\
        --output_path points --Mapper.ba_refine_sensor_from_rig 0

triangulates one picture. For many, `colmap mapper --Mapper.ba_refine_sensor_from_rig 0
--Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_extra_params 0` also estimates the motion of the rig.
nerfstudio: `ns-train splatfacto --data nerfstudio`.

Anipose (also lightning-pose) and DeepLabCut 3-D: the pictures of each camera are made with

| camera | `{FFMPEG} ... NAME.mp4` | error of k1 k2 p1 p2 k3, px |
|---|---|---|
{pictures_table(pose_cameras(layout, views))}
`-noautorotate` keeps frames in the sensor's orientation. Pictures cropped from a video with a rotation flag keep the
flag, by which players and OpenCV rotate them: for such a video, also put `-display_rotation 0` (ffmpeg 6 or newer)
before `-i`.

For frames of W x H px, the point (u, v) of the frame is (W - 1 - u - x, v - y) in a picture made with
`hflip,crop=w:h:x:y`, and (u - x, H - 1 - v - y) with `vflip`. For another crop, subtract the change of x and y from the
third column of `matrix`. DeepLabCut names a pair of cameras "NAME-NAME" and gives points in the frame of the first.

The last columns give the largest error of each camera within its view, in px: as a pinhole with the layout's lens
({layout.camera.lens_model}), and in the lens models of each format. OpenCV has k1 k2 p1 p2 k3, k4 k5 k6 and s1 s2 s3
s4, or the k1 k2 k3 k4 of a fisheye; ROS and COLMAP have the same without s1 to s4; nerfstudio has k1 k2 p1 p2 k3, or a
fisheye; Kalibr has the same without k3. Any other lens is replaced by the nearest one over the view. A flat
first-surface mirror is exactly a pinhole. A second-surface or bent mirror is not: the camera here is the pinhole that
fits it best over its view, at {depths} mm from its virtual centre.

| view | first pixel of the flipped frame | size px | pinhole | {" | ".join(FORMATS)} |
|---|---|---|---|{"---|" * len(FORMATS)}
{rows}"""
