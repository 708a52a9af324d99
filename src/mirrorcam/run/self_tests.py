"""A short test of each part of an installation, on synthetic data, each in its own process.

Each test returns a sentence with its measurement, and raises if that is wrong. A library that crashes ends only its
own process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import mirrorcam
from mirrorcam.core.console.system_libraries import missing_library
from mirrorcam.core.processes.child_program import run_program
from mirrorcam.core.values import Value
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.run.installation import Installation

TIMEOUT_S = 300.0
"""Each test takes less than ten seconds on two idle cores, or 20 the first time, when loops are compiled."""
WIDTH_PX, HEIGHT_PX, FOCAL_PX = 640, 360, 453.0
PLANE_MM = 300.0


class SelfTest(Value):
    """The result of a test: its finding or the reason for its failure (`said`), and its duration, s."""

    name: str
    passed: bool
    said: str
    seconds: float


def parts_to_test(installed: Installation) -> tuple[str, ...]:
    """Return the names of the tests of installed parts, in the order of `TESTS`."""
    missing = {extra.name for extra in installed.extras if extra.missing}
    # Finite elements need the solids of `cad` and the program gmsh.
    if "cad" in missing or any(program.name == "gmsh" and program.path is None for program in installed.programs):
        missing.add("fe")
    return tuple(name for name in TESTS if name not in missing)


def self_tests(names: tuple[str, ...]) -> Iterator[SelfTest]:
    """Run tests by their names in `TESTS`, one after another, each in its own process."""
    source = str(Path(mirrorcam.__file__).parents[1])  # so that this `mirrorcam` is tested, not another one
    inherited = [path for path in [os.environ.get("PYTHONPATH")] if path]
    # One thread per library: on a busy machine, their threads wait for each other.
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment = os.environ | threads | {"PYTHONPATH": os.pathsep.join([source, *inherited])}
    for name in names:
        code = f"from mirrorcam.run.self_tests import report; report({name!r})"
        start_s = time.monotonic()
        try:
            process = run_program([sys.executable, "-P", "-c", code], timeout_s=TIMEOUT_S, environment=environment)
        except subprocess.TimeoutExpired:
            passed, finding = False, f"took longer than {TIMEOUT_S:g} s"
        else:
            passed, finding = process.returncode == 0, _finding(process)
        yield SelfTest(name=name, passed=passed, said=finding, seconds=time.monotonic() - start_s)


def _finding(process: subprocess.CompletedProcess[bytes]) -> str:
    """Return the sentence of a passed test; for a failed one, the missing system library, the last line of its
    traceback, or its exit code."""
    lines = (process.stderr if process.returncode else process.stdout).decode("utf-8", "replace").strip().splitlines()
    if process.returncode == 0:
        return str(json.loads(lines[-1]))
    missing = missing_library("\n".join(lines))
    return missing or (lines[-1] if lines else f"ended with exit code {process.returncode}")


def report(name: str) -> None:
    """Run one test in this process, and print its sentence as JSON."""
    print(json.dumps(TESTS[name]()))


def expect(correct: bool, finding: str) -> str:
    """Return the finding, or raise ValueError with it if it is wrong."""
    if not correct:
        raise ValueError(finding)
    return finding


def _small_layout() -> Layout:
    """Design four mirrors for a small camera."""
    import mirrorcam

    centre = {"cx_px": (WIDTH_PX - 1) / 2, "cy_px": (HEIGHT_PX - 1) / 2}
    camera = mirrorcam.Camera(width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=FOCAL_PX, fy_px=FOCAL_PX, **centre)
    return mirrorcam.design(mirrorcam.DesignSpec(camera=camera, rows=2, cols=2))


def _frame(
    layout: Layout, texture: NDArray[np.uint8], texel_mm: float, rig_from_sheet: NDArray[np.float64], *, mirrored: bool
) -> NDArray[np.uint8]:
    """Return the camera's picture (h, w) of a printed sheet, via the mirrors if `mirrored`, or without them."""
    import cv2
    import numpy as np

    camera = layout.camera
    u, v = np.meshgrid(np.arange(camera.width_px, dtype=float), np.arange(camera.height_px, dtype=float))
    rays = camera.unproject(np.stack([u, v], axis=-1))
    rotation, shift = rig_from_sheet[:3, :3], rig_from_sheet[:3, 3]
    picture = np.full(rays.shape[:2], 60, dtype=np.uint8)
    for mirror in layout.mirrors if mirrored else (None,):
        inside = np.ones(picture.shape, dtype=np.uint8)
        start, directions = np.zeros(3), rays
        if mirror is not None:
            inside[:] = 0
            corners = camera.pixels_from_normalized(mirror.outline_normalized)
            cv2.fillConvexPoly(inside, np.rint(corners).astype(np.int32), 1)
            start, directions = mirror.virtual_centre_in_rig_mm, rays @ mirror.reflection
        length = (shift - start) @ rotation[:, 2] / (directions @ rotation[:, 2])
        points = start + length[..., None] * directions - shift
        on_sheet = (points @ rotation[:, :2] / texel_mm - 0.5).astype(np.float32)
        sheet = cv2.remap(texture, on_sheet[..., 0], on_sheet[..., 1], cv2.INTER_LINEAR, borderValue=(200,))
        picture = np.where(inside.astype(bool) & (length > 0), sheet, picture)
    return cv2.GaussianBlur(picture, (0, 0), 0.8).astype(np.uint8)


def _pose(layout: Layout, *, mirrored: bool) -> NDArray[np.float64]:
    """Return rig_from_sheet (4, 4) of a sheet whose origin is in front of the views, or of the camera itself."""
    import numpy as np

    pose = np.eye(4)
    if mirrored:
        x, y, _ = layout.virtual_centres_in_view_mm.mean(axis=(0, 1))
        pose[:3, :3] = layout.view_from_rig.T
        pose[:3, 3] = layout.view_from_rig.T @ [x, y, PLANE_MM]
    else:
        pose[2, 3] = PLANE_MM
    return pose


def _design() -> str:
    layout = _small_layout()
    return expect(len(layout.mirrors) == 4, f"{len(layout.mirrors)} mirrors designed")


def _calibrate() -> str:
    import numpy as np
    from scipy.spatial.transform import Rotation

    import mirrorcam
    from mirrorcam.optics.geometry.perturbations import draw_as_built
    from mirrorcam.optics.geometry.tolerances import Tolerances

    nominal = _small_layout()
    built = draw_as_built(nominal, Tolerances(), np.random.default_rng(0))
    board = mirrorcam.Charuco(cols=9, rows=7, square_mm=20.0, marker_mm=15.0)
    texture = board.image(32)
    pictures: dict[bool, list[Any]] = {True: [], False: []}
    for mirrored, group in pictures.items():
        for angles in ((0, 0, 0), (30, 0, 0), (-30, 10, 0), (0, 30, 5), (0, -30, -5), (20, 20, 90), (-20, -25, 45)):
            pose = _pose(nominal, mirrored=mirrored)
            pose[:3, :3] @= Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
            pose[:3, 3] -= pose[:3, :3] @ board.corners_in_board_mm.mean(axis=0)
            group.append(_frame(built, texture, board.square_mm / 32, pose, mirrored=mirrored))
    calibration = mirrorcam.calibrate(pictures[True], pictures[False], nominal, board, model=RequestedModel())
    pairs = zip(calibration.layout.mirrors, built.mirrors, strict=True)
    worst = np.rad2deg(max(np.linalg.norm(np.cross(a.normal_in_rig, b.normal_in_rig)) for a, b in pairs))
    return expect(bool(worst < 0.05), f"normals of {len(built.mirrors)} mirrors calibrated to {worst:.3f} deg")


def _decode() -> str:
    import cv2
    import numpy as np

    import mirrorcam

    layout = _small_layout()
    noise = np.random.default_rng(0).normal(0.0, 1.0, (1200, 1200)).astype(np.float32)
    waves = cv2.GaussianBlur(noise, (0, 0), 4.0)
    texture = np.clip(120.0 + 40.0 * waves / waves.std(), 0, 255).astype(np.uint8)
    pose = _pose(layout, mirrored=True)
    pose[:3, 3] -= pose[:3, :3] @ [300.0, 300.0, 0.0]
    frame = np.repeat(_frame(layout, texture, 0.5, pose, mirrored=True)[..., None], 3, axis=2)
    depth = mirrorcam.estimate_depth(mirrorcam.Decoder(layout).decode(frame), near_mm=200.0, far_mm=600.0)
    median_mm = float(np.nanmedian(depth.depth_mm))
    return expect(
        abs(median_mm - PLANE_MM) < 0.02 * PLANE_MM, f"a plane at {PLANE_MM:g} mm measured at {median_mm:.1f} mm"
    )


def _cad() -> str:
    import numpy as np

    from mirrorcam.cad.parts.part_solids import built_of
    from mirrorcam.cad.plan.prisms import box
    from mirrorcam.cad.write.part_export import write_step, write_stl

    import_module("mirrorcam.cad.write.threemf")  # loads the libraries of meshes and 3MF files
    part = built_of("box", [box((0, 0, 0), (30, 20, 10))], [box((10, 10, -1), (20, 30, 11))])
    with TemporaryDirectory() as folder:
        write_step(Path(folder, "box.step"), part)
        write_stl(Path(folder, "box.stl"), part)
        facet = np.dtype([("numbers", "<f4", (4, 3)), ("attribute", "<u2")])
        corners = np.fromfile(Path(folder, "box.stl"), facet, offset=84)["numbers"][:, 1:].astype(float)
    mesh_mm3 = float(np.linalg.det(corners).sum() / 6.0)
    correct = bool(abs(mesh_mm3 - 5000.0) < 0.01 and abs(part.volume - 5000.0) < 1e-6)
    return expect(correct, f"a solid of {part.volume:.1f} mm3, its mesh of {mesh_mm3:.1f} mm3")


def _render() -> str:
    import mirrorcam

    settings = mirrorcam.RenderSettings(renderer="fast", maps=False)
    layout = _small_layout()
    with TemporaryDirectory() as folder:
        request = mirrorcam.SetRequest(layout=layout, frames=1, base_frames=0, settings=settings)
        dataset = mirrorcam.render_set(request, Path(folder, "set"))
        picture = mirrorcam.read_image(Path(folder, "set", dataset.frame_names[0]))
    spread = float(picture.std())
    correct = picture.shape == (HEIGHT_PX, WIDTH_PX, 3) and spread > 10.0
    return expect(correct, f"a frame whose levels spread by {spread:.0f}")


def _fe() -> str:
    from mirrorcam.cad.checks.elasticity.tetrahedra import tetrahedra_of
    from mirrorcam.cad.parts.part_solids import built_of
    from mirrorcam.cad.plan.prisms import box
    from mirrorcam.cad.write.part_export import write_step

    with TemporaryDirectory() as folder:
        write_step(Path(folder, "box.step"), built_of("box", [box((0, 0, 0), (30, 20, 10))], []))
        mesh = tetrahedra_of(Path(folder, "box.step"), 5.0)
    return expect(abs(mesh.volume_mm3 - 6000.0) < 1e-3, f"a box of {mesh.volume_mm3:.1f} mm3 meshed")


def _cluster() -> str:
    from distributed import Client

    with Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        answer = client.submit(sum, [1, 2, 3]).result(timeout=TIMEOUT_S)
    return expect(answer == 6, f"a worker in this process answered {answer}")


def _remote() -> str:
    import fsspec

    with fsspec.open("memory://mirrorcam-doctor/part", "wb") as file:
        file.write(b"stored")
    with fsspec.open("memory://mirrorcam-doctor/part", "rb") as file:
        content = file.read()
    return expect(content == b"stored", f"{len(content)} bytes stored in memory and read")


def _parquet() -> str:
    import pyarrow as pa
    import pyarrow.parquet as pq

    stored = pa.BufferOutputStream()
    pq.write_table(pa.table({"value": [1.5, 2.5]}), stored)
    content = pq.read_table(pa.BufferReader(stored.getvalue()))["value"].to_pylist()
    return expect(content == [1.5, 2.5], f"{len(content)} rows written and read")


def _robot() -> str:
    import numpy as np

    import mirrorcam

    light_field = mirrorcam.Decoder(_small_layout()).decode(np.full((HEIGHT_PX, WIDTH_PX, 3), 90, dtype=np.uint8))
    with TemporaryDirectory() as folder:
        mirrorcam.write_light_field(Path(folder, "a.mcap"), light_field, "mcap")
        content = mirrorcam.open_light_field(Path(folder, "a.mcap"))
    return expect(bool(np.array_equal(content.samples, light_field.samples)), "a ROS 2 bag written and read")


def _view() -> str:
    import numpy as np
    import rerun

    with TemporaryDirectory() as folder:
        rerun.init("mirrorcam_self_test", spawn=False)
        rerun.save(Path(folder, "a.rrd"))
        rerun.log("picture", rerun.Image(np.zeros((8, 8, 3), dtype=np.uint8)))
        rerun.disconnect()
        size = Path(folder, "a.rrd").stat().st_size
    return expect(size > 100, f"a picture logged, {size} bytes; the window is not opened")


def _studio() -> str:
    import mirrorcam
    from mirrorcam.studio.page import studio_page

    page = studio_page(mirrorcam.DesignSpec(), Path("output"), nonce="0")
    import_module("mirrorcam.studio.server")
    return expect("<html" in page, f"a page of {len(page) / 1000:.0f} kB")


TESTS: dict[str, Callable[[], str]] = {
    "design": _design,
    "calibrate": _calibrate,
    "decode": _decode,
    "cad": _cad,
    "render": _render,
    "fe": _fe,
    "cluster": _cluster,
    "remote": _remote,
    "parquet": _parquet,
    "robot": _robot,
    "view": _view,
    "studio": _studio,
}
"""Tests by name: those of the base installation first, then one for each extra."""
