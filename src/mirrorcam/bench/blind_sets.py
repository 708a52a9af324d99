"""Rendered sets as a calibrator may see them: what anyone with the device would have, and nothing of the truth."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Literal

from pydantic import Field

from mirrorcam.core.disk.files import inside, stored_bytes, write_text
from mirrorcam.core.values import Matrix3, Value
from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera, virtual_cameras
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.dataset import KNOWN, Dataset

VIEWS = "views.json"


class DescribedView(Value):
    """A mirror as a camera of the flipped frame: the part that shows it, and its camera by the data sheet.

    Attributes
    ----------
    x, y, width, height
        The pixels of the flipped frame that hold the view.
    outline_px
        Corners (n, 2) of what the mirror shows, px of the flipped frame.
    camera_matrix
        3 x 3, of the whole flipped frame.
    """

    name: str
    x: int
    y: int
    width: int
    height: int
    outline_px: tuple[tuple[float, float], ...]
    camera_matrix: Matrix3

    @classmethod
    def of(cls, view: VirtualCamera) -> DescribedView:
        """The description of a mirror's camera."""
        part = view.sub_image
        return cls(
            name=view.name,
            x=part.x,
            y=part.y,
            width=part.width,
            height=part.height,
            outline_px=view.outline_px.tolist(),
            camera_matrix=view.camera.matrix,
        )


class DescribedViews(Value):
    """`views.json` of a set: the views of a device as designed, for calibrators that know nothing of mirrors.

    The `views.json` beside an exported light field is another file, of the schema `mirrorcam.views/1`.
    `flip_code` is that of `cv2.flip`, with which a frame becomes the picture of every view's camera.
    """

    schema_id: Literal["mirrorcam.device_views/1"] = Field(default="mirrorcam.device_views/1", alias="schema")
    width_px: int
    height_px: int
    flip_code: Literal[0, 1]
    views: tuple[DescribedView, ...]


def described_views(layout: Layout) -> DescribedViews:
    """The views of a nominal layout."""
    views = virtual_cameras(layout)
    return DescribedViews(
        width_px=layout.camera.width_px,
        height_px=layout.camera.height_px,
        flip_code=1 if views[0].flip == "left-right" else 0,
        views=tuple(map(DescribedView.of, views)),
    )


def write_blind_set(folder: Path, place: Path) -> None:
    """Copy a set's pictures, nominal layout and board into a new folder, with `views.json`; no truth.

    Raises InputError in one line where the set lacks one of its files.
    """
    dataset = Dataset.load(folder)
    names = (*KNOWN, *dataset.frame_names, *dataset.base_names, *filter(None, [dataset.video_name]))
    for name in names:
        source = inside(folder, name)
        stored_bytes(source)
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, place / name)
    write_text(place / VIEWS, described_views(Layout.load(folder / KNOWN[0])).model_dump_json(by_alias=True) + "\n")
