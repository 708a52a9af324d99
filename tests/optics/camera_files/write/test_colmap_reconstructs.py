"""COLMAP, given nothing but the exported folder, finds a textured plane where it stood in the picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.write import write_exports
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render


@dataclass(frozen=True)
class Texture:
    """Noise of many sizes on a sheet of 24 x 18 squares, in place of a board."""

    square_mm: float = 12.0

    @property
    def corners_in_board_mm(self) -> FloatArray:
        return np.array([[0.0, 0.0, 0.0], [24 * self.square_mm, 18 * self.square_mm, 0.0]])

    def image(self, px_per_square: int) -> NDArray[np.uint8]:
        random = np.random.default_rng(1)
        height, width = 18 * px_per_square, 24 * px_per_square
        total = np.zeros((height, width), dtype=np.float32)
        for size in (4, 8, 16, 32):
            cells = random.normal(0.0, 1.0, (height // size, width // size)).astype(np.float32)
            total += cv2.resize(cells, (width, height), interpolation=cv2.INTER_CUBIC) * np.float32(np.sqrt(size))
        return np.clip(127.0 + 50.0 * (total - total.mean()) / total.std(), 0.0, 255.0).astype(np.uint8)


def two_by_two() -> Layout:
    camera = Camera(
        width_px=640,
        height_px=360,
        fx_px=450.0,
        fy_px=452.0,
        cx_px=322.3,
        cy_px=176.2,
        distortion=[0.08, -0.11, 1.2e-3, -0.8e-3, 0.02],
    )
    return faceted_parabola(camera, DesignSpec(camera=camera, rows=2, cols=2), fill=0.9)


def triangulated(folder: Path) -> pycolmap.Reconstruction:
    """The commands of the exports' README, by their Python names."""
    database = folder / "database.db"
    reading = pycolmap.ImageReaderOptions()
    reading.mask_path = folder / "masks"
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.use_gpu, extraction.num_threads = False, 1
    extraction.sift.max_num_features = 1000
    pycolmap.extract_features(
        database,
        folder / "images",
        camera_mode=pycolmap.CameraMode.PER_FOLDER,
        reader_options=reading,
        extraction_options=extraction,
    )
    with pycolmap.Database.open(database) as opened:
        pycolmap.apply_rig_config(pycolmap.read_rig_config(folder / "rig_config.json"), opened)
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu, matching.num_threads = False, 1
    pycolmap.match_exhaustive(database, matching_options=matching)
    model = pycolmap.Reconstruction(folder / "sparse")
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_sensor_from_rig = False
    return pycolmap.triangulate_points(model, database, folder / "images", folder / "points", options=options)


def test_colmap_triangulates_the_plane_that_was_seen(tmp_path: Path) -> None:
    layout, texture = two_by_two(), Texture()
    rig_from_board = posed(texture, np.array([0.0, 420.0, 80.0]), np.array([15.0, 10.0, 5.0]), direct=False)
    frame = render(layout.camera, layout, texture, rig_from_board, noise_grey=1.0)
    write_image(tmp_path / "frame.png", frame)
    write_exports(layout, tmp_path, [tmp_path / "frame.png"])
    model = triangulated(tmp_path / "colmap")
    points_in_rig = np.array([point.xyz for point in model.points3D.values()]) * 1000.0
    off_plane_mm = (points_in_rig - rig_from_board[:3, 3]) @ rig_from_board[:3, 2]
    assert len(points_in_rig) > 500
    assert model.compute_mean_reprojection_error() < 0.15
    assert abs(np.median(off_plane_mm)) < 0.3
    assert np.median(np.abs(off_plane_mm)) < 1.0
