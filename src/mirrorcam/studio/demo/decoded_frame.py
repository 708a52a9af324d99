"""The light field of one frame, with its depth, views between its views, and features."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.equalisation import measure
from mirrorcam.optics.light_field.features import FeatureFinder, Features
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.perspective import insert_views
from mirrorcam.optics.light_field.render.view_depths import ViewDepths

LARGEST_FRAME_BYTES = 5_000_000
WIDTH_PX = 480
"""Width of a view: about the width in which the page shows it."""
BETWEEN = 2
"""Views between adjacent ones: with fewer, a blurred background becomes separate copies."""
STEPS = 5
COMPILED_PX = 64
"""Width of views that are only there to compile the code."""


@dataclass(frozen=True, eq=False)
class DecodedFrame:
    """What the page shows of one frame.

    Attributes
    ----------
    frame_jpeg
        The frame's file.
    light_field
        Its views.
    depths
        Depths of all views, measured in the central one.
    dense
        The views, with `BETWEEN` rendered ones between adjacent ones.
    features
        Features that more than half of the views agree on.
    """

    frame_jpeg: bytes
    light_field: LightField
    depths: ViewDepths
    dense: LightField
    features: Features

    @classmethod
    def of(cls, frame: Path, layout: Path, progress: Progress = no_progress) -> Self:
        """Decode a frame (JPEG) by its layout; `progress` is called with the steps done and their total."""
        picture = read_image(frame)
        progress(0, STEPS)
        decoder = Decoder(Layout.load(layout), width_px=WIDTH_PX)
        progress(1, STEPS)
        light_field = decoder.equalised(measure([decoder.decode(picture)])).decode(picture)
        progress(2, STEPS)
        depth = DepthEstimator(light_field).estimate(light_field)
        depths = ViewDepths.of_reference(light_field, depth.depth_mm)
        progress(3, STEPS)
        dense = insert_views(light_field, depths, BETWEEN)
        progress(4, STEPS)
        features = FeatureFinder(light_field, "ORB").find(light_field)
        progress(5, STEPS)
        return cls(read_bytes(frame, LARGEST_FRAME_BYTES), light_field, depths, dense, features)


def compile_ahead(frame: Path, layout: Path) -> None:
    """Compile, at the first use, the second half of what `DecodedFrame.of` needs, in another process meanwhile."""
    light_field = Decoder(Layout.load(layout), width_px=COMPILED_PX).decode(read_image(frame))
    DepthEstimator(light_field).compile_ahead(light_field)
