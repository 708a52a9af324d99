"""The Light Field Toolbox for MATLAB (Dansereau): a .mat file with `LF` and its intrinsic matrix.

`LF` is [t, s, v, u, c], t down and s right, with the weight as the last channel, as integers up to their maximum or as
floats up to 1. `RectOptions.RectCamIntrinsicsH` is H of Dansereau et al. (CVPR 2013), in metres, for indices from 1:
ray [s, t, u, v, 1] = H [i, j, k, l, 1], through (s, t, 0) towards (u, v, 1), where i belongs to s.

The toolbox's slope of LFFiltShiftSum is px per view times (N - 1) / N, because its shifts of N views span N steps. Its
sign is that of du/ds, negative for points nearer than the plane of zero disparity.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.core.disk.files import atomic, stored_bytes
from mirrorcam.core.disk.hdf5_arrays import read_hdf5
from mirrorcam.core.disk.mat5_arrays import HEADER_BYTES, read_mat5
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Format, depthless_writer, single_reader
from mirrorcam.optics.light_field.io.view_images import weight_bytes
from mirrorcam.optics.light_field.io.views_file import check_weights, even_views, views_of_fields
from mirrorcam.optics.light_field.light_field import LightField, Views

STRUCT = "MirrorCam"
READABLE_MAT = "a .mat file that can be read"
MAX_BYTES = 2**31 - 1
"""Maximum size of a variable in a .mat file before version 7.3, which is HDF5."""


def intrinsics(views: Views) -> FloatArray:
    """Return H (5, 5) of the views, moved to the nearest even grid."""
    even_grid = views.on_regular_grid()
    row, col = np.argwhere((views.positions_mm == 0).all(axis=2))[0]
    distance_m = even_grid.reference_distance_mm / 1000.0
    h = np.eye(5)
    for axis, (count, central) in enumerate(((even_grid.cols, col), (even_grid.rows, row))):
        step_m = even_grid.step_mm("t" if axis else "s") / 1000.0 if count > 1 else 0.0
        h[axis, axis], h[axis, 4] = step_m, -step_m * (central + 1)
        h[axis + 2, axis], h[axis + 2, axis + 2] = -step_m / distance_m, 1.0 / even_grid.focal_px
        # Pixel k = cx + 1 of the reference view looks straight ahead.
        h[axis + 2, 4] = -(even_grid.centre_px[axis] + 1.0) / even_grid.focal_px - h[axis, 4] / distance_m
    return h


def views_of(h: FloatArray, grid: tuple[int, int], size: tuple[int, int], source: str) -> Views:
    """Build the views (rows, cols) that H describes; a lenslet camera's views are at the intersections of its rays.

    Raises InputError for pixels that are not square, and views without a common plane in front of them.
    """
    if h.shape != (5, 5) or not np.isfinite(h).all() or not (h[2, 2] > 0 and np.isclose(h[2, 2], h[3, 3], rtol=1e-3)):
        raise InputError(f"{source}: H does not have square pixels: {np.diag(h).tolist()}")
    crossing_m = -np.array([h[0, 2] / h[2, 2], h[1, 3] / h[3, 3]])
    steps = np.array([h[axis, axis] + crossing_m[axis] * h[axis + 2, axis] for axis in (0, 1)])
    counts = np.array([grid[1], grid[0]])
    inverse_distances = np.array([-h[axis + 2, axis] / steps[axis] for axis in (0, 1) if counts[axis] > 1])
    if (
        not inverse_distances.size
        or not (inverse_distances >= 0).all()
        or np.ptp(inverse_distances) > 0.02 * inverse_distances.mean()
    ):
        raise InputError(
            f"{source}: H has no common plane of zero disparity in front: 1/distance {inverse_distances.tolist()} 1/m"
        )
    central = counts // 2
    centre = [
        -(h[axis + 2, axis] * (central[axis] + 1) + h[axis + 2, 4]) / h[axis + 2, axis + 2] - 1.0 for axis in (0, 1)
    ]
    t, s = np.meshgrid(np.arange(grid[0]), np.arange(grid[1]), indexing="ij")
    positions_mm = np.stack([s, t], axis=-1).astype(np.float64) * np.where(counts > 1, steps, 0.0) * 1000.0
    return Views.parallel(
        positions_mm,
        size,
        1.0 / float(h[2, 2]),
        float(1000.0 / inverse_distances.mean()) if inverse_distances.any() else np.inf,
        np.array(centre),
    )


def write_lftoolbox(path: Path, light_field: LightField) -> None:
    """Write a light field as a .mat file of the toolbox; its struct `MirrorCam` holds the true positions.

    Raises InputError above 2 GiB.
    """
    from scipy.io import savemat

    samples = light_field.samples
    weights: Any = weight_bytes(light_field.weights) if samples.dtype == np.uint8 else light_field.weights
    lf = np.concatenate([samples, weights[..., None]], axis=-1)
    if lf.nbytes > MAX_BYTES:
        raise InputError(f"{path}: {lf.nbytes / 2**30:.1f} GiB of samples, but a .mat file holds less than 2")
    fields = {name: getattr(light_field, name) for name in Views.__dataclass_fields__}
    variables = {
        "LF": lf,
        "GeneratedByInfo": {"mfilename": "mirrorcam", "VersionStr": light_field.layout_identity},
        "RectOptions": {"RectCamIntrinsicsH": intrinsics(light_field)},
        STRUCT: fields,
    }
    with atomic(path) as temporary:
        savemat(temporary, variables, appendmat=False, do_compression=True, oned_as="column")
        # MATLAB's header contains the time of day; equal light fields must give equal bytes.
        with temporary.open("r+b") as file:
            file.write(b"MATLAB 5.0 MAT-file, light field of mirrorcam".ljust(116))


def read_lftoolbox(path: Path, assumed: Assumed = NOTHING) -> LightField:
    """Read a light field from a .mat file: the toolbox's (-v7.3), an older version, or one of `write_lftoolbox`.

    The geometry comes from `MirrorCam`, else from H, else it is assumed. Raises a one-line InputError for any other
    file.
    """
    stored_bytes(path)
    with path.open("rb") as file:
        is_hdf5 = b"MATLAB 7.3" in file.read(HEADER_BYTES)
    variables = _read_hdf5(path) if is_hdf5 else _read_mat5(path)
    lf, h = variables.get("LF"), variables.get("H")
    if not isinstance(lf, np.ndarray) or lf.ndim not in (4, 5):
        raise InputError(f"{path}: has no array LF [t, s, v, u, c]")
    samples, weights = _samples_and_weights(lf if lf.ndim == 5 else lf[..., None], path)
    rows, cols, height, width = weights.shape
    if STRUCT in variables:
        fields = variables[STRUCT]
        views = views_of_fields(fields if isinstance(fields, dict) else {}, f"{path}: its {STRUCT}")
    elif isinstance(h, np.ndarray):
        views = views_of(np.asarray(h, np.float64), (rows, cols), (width, height), f"{path}: RectOptions")
    else:
        views = even_views(path, assumed, (rows, cols), (width, height))
    try:
        check_weights(weights)
        return LightField.of(views, samples, weights)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read_mat5(path: Path) -> dict[str, Any]:
    """Read `LF`, `H` and `MirrorCam` from a file of MATLAB 5 to 7, as far as available."""
    variables = read_mat5(path, ("LF", "RectOptions", STRUCT), READABLE_MAT)
    options = variables.get("RectOptions")
    return {**variables, "H": options.get("RectCamIntrinsicsH") if isinstance(options, dict) else None}


def _read_hdf5(path: Path) -> dict[str, Any]:
    """Read `LF` and `H` from a file of MATLAB 7.3; HDF5 reverses the axes of its arrays."""
    arrays = read_hdf5(path, {"LF": "LF", "H": "RectOptions/RectCamIntrinsicsH"}, READABLE_MAT)
    return {name: array.T for name, array in arrays.items()}


def _samples_and_weights(lf: Any, path: Path) -> tuple[Any, Any]:
    """Split LF [t, s, v, u, c] into samples and weights; the second or fourth channel is the weight."""
    if lf.dtype.kind == "u" and lf.dtype.itemsize <= 2:
        full_scale = float(np.iinfo(lf.dtype).max)
        colours = (lf.astype(np.float32) / np.float32(full_scale)) if lf.dtype != np.uint8 else lf
    elif lf.dtype.kind == "f":
        full_scale, colours = 1.0, lf.astype(np.float32)
    else:
        raise InputError(f"{path}: LF is {lf.dtype}, expected uint8, uint16 or floating point")
    channels = lf.shape[-1]
    if channels not in (1, 2, 3, 4):
        raise InputError(f"{path}: LF has {channels} channels, expected colours and perhaps a weight")
    weights = np.ones(lf.shape[:4], np.float32)
    if channels in (2, 4):
        weights = np.ascontiguousarray(lf[..., -1] / np.float32(full_scale), np.float32)
        colours = colours[..., :-1]
    samples = np.ascontiguousarray(colours)
    samples[weights <= 0] = 0
    return samples, weights


FORMAT = Format(
    name="lftoolbox",
    ending=".mat",
    detect=lambda path: path.suffix.lower() == ".mat" and not path.is_dir(),
    read=single_reader(read_lftoolbox),
    write=depthless_writer(write_lftoolbox),
    needs_grid=True,
)
