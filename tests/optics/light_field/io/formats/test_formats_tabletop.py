"""A tabletop scene photographed through mirrors as built, read from other tools' files, against its true depth."""

from __future__ import annotations

from configparser import ConfigParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.io import loadmat, savemat

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.registry import formats, open_light_field, write_light_field
from mirrorcam.optics.light_field.io.light_field_format import Assumed
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest, read_map, render_tabletop

THEIRS = ("lftoolbox", "hci", "stanford", "colmap", "nerfstudio")
"""Formats that state the positions of the views."""


def forget(path: Path) -> None:
    """Remove the files of a light field that only this project reads."""
    if path.suffix == ".mat":
        said = loadmat(path)
        savemat(path, {name: said[name] for name in ("LF", "RectOptions")})
    elif (path / "views.json").exists():
        (path / "views.json").unlink()
    else:
        parser = ConfigParser()
        parser.read(path / "parameters.cfg", encoding="utf-8")
        assert parser.remove_section("mirrorcam")
        with (path / "parameters.cfg").open("w", encoding="utf-8") as text:
            parser.write(text)


def unlike(light_field: LightField, distance_mm: FloatArray, *, row_only: bool = False) -> float:
    """Return the mean difference in grey, up to 20, between the middle view at distances (v, u) and the other views."""
    scale = (distance_mm / light_field.focal_px)[..., None]
    points = np.concatenate(
        [(light_field.pixel_grid() - light_field.centre_px) * scale, distance_mm[..., None]], axis=-1
    )
    seen = light_field.project_in_view(points).astype(np.float32)
    grey = light_field.samples.astype(np.float32).mean(axis=-1)
    differences = []
    for index in np.ndindex(3, 3):
        if index == (1, 1) or (row_only and index[0] != 1):
            continue
        maps = seen[index][..., 0], seen[index][..., 1]
        both: Any = light_field.weights[1, 1] > 0.99
        both &= cv2.remap(light_field.weights[index], *maps, cv2.INTER_LINEAR) > 0.99
        moved = cv2.remap(grey[index], *maps, cv2.INTER_LINEAR)
        differences.append(np.minimum(np.abs(moved - grey[1, 1])[both], 20.0))
    return float(np.mean(np.concatenate(differences)))


@pytest.mark.slow
def test_the_tabletops_true_depth_fits_the_files_of_other_tools(default_layout: Layout, tmp_path: Path) -> None:
    request = TabletopRequest(layout=default_layout, seed=2, spp=16, sensor=SENSORS["ideal"])
    manifest = render_tabletop(request, tmp_path)
    assert manifest.central_view == (1, 1)
    layout = Layout.load(tmp_path / "truth/layout.json")
    light_field = Decoder(layout).decode(read_image(tmp_path / manifest.frame_name))
    truth = read_map(tmp_path / "truth/depth/1_1.exr", "depth").astype(float)
    distance_mm = truth - light_field.reference_depth_mm + light_field.reference_distance_mm
    opposite_mm = 1.0 / (2.0 / light_field.reference_distance_mm - 1.0 / distance_mm)
    for to in THEIRS:
        path = tmp_path / f"tabletop{formats()[to].ending}"
        write_light_field(path, light_field, to)
        forget(path)
        given = Assumed(focal_px=light_field.focal_px, reference_depth_mm=light_field.reference_distance_mm)
        found = open_light_field(path, assumed=given)
        # parameters.cfg has one step, the horizontal one.
        row_only = to == "hci"
        exact, opposite = (unlike(light_field, each, row_only=row_only) for each in (distance_mm, opposite_mm))
        figure = unlike(found, _padded(distance_mm, found.weights.shape[2:]), row_only=row_only)
        print(to, figure, exact, opposite)
        assert exact < 0.5 * opposite
        # Cameras are exact; names lack positions along z; H and parameters.cfg have only even steps.
        assert figure < {"colmap": 1.01, "nerfstudio": 1.01, "stanford": 1.05}.get(to, 2.0) * exact


def _padded(distance_mm: FloatArray, size: tuple[int, ...]) -> FloatArray:
    """Return distances, padded like COLMAP's pictures."""
    return np.pad(distance_mm, ((size[0] - len(distance_mm), 0), (size[1] - distance_mm.shape[1], 0)), "edge")
