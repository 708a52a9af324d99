"""Make what shows the table-top scene outside the tour: `python -m docs.make_scene [--work FOLDER]`.

After `python docs/make_tour.py`, from the scene in its folder, by default output/tour: the frame and layout of
`mirrorcam demo`, the moving picture of README.md, and the overview in docs/scenes.md; also the previews of four
designs there.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import mirrorcam.studio.demo as demo
from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.io.view_images import rgb, tiled_views
from mirrorcam.optics.light_field.render.perspective import orbit, render_view
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus, to_bytes
from mirrorcam.render_scenes.preview.preview_frame import preview_frame
from mirrorcam.render_scenes.preview.products import preview_products
from mirrorcam.simulation.rendering import OVERVIEW
from mirrorcam.studio.demo.decoded_frame import DecodedFrame

IMAGES = Path(__file__).parent / "images"
MOVIE = "light_field.webp"
STEP_MS, HOLD_MS, DEPTH_MS = 60, 1800, 3500
SWEEP, ORBIT = 40, 48
CAPTION_PX, GAP_PX, FONT_PX, LABEL_PX = 32, 8, 18, 13
LABELS = 14
"""Features whose distance is written beside them."""
QUALITY = 72
NEAR_MM, FAR_MM = 285.0, 600.0
"""Range of the focus: the glass ball, and the wall."""
PREVIEW_PX, ROW_PX = 960, 200
PREVIEWED = (DesignSpec(), DesignSpec(rows=5, cols=5), DesignSpec(scale_mm=40.0), DesignSpec(scale_mm=160.0))


@dataclass(frozen=True)
class MovieFrame:
    """A picture of the movie: its caption, the picture at the right (h, w, 3), and how long it is shown."""

    caption: str
    picture: NDArray[np.uint8]
    duration_ms: int = STEP_MS


def movie_frames(decoded: DecodedFrame) -> list[MovieFrame]:
    """Return depth, views, features, a sweep of the focus there and back, and an orbit of the viewpoint."""
    field = decoded.light_field
    size = field.width_px, field.height_px
    depth = coloured(1.0 / decoded.depths.depth_mm(field)[reference_index(field)])
    views = np.asarray(cv2.resize(tiled_views(field), size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    there = np.linspace(1.0 / NEAR_MM, 1.0 / FAR_MM, SWEEP // 2)
    focused = [to_bytes(refocus(decoded.dense, FocalPlane.at_depth(field, 1.0 / depth_mm))) for depth_mm in there]
    around = [to_bytes(render_view(field, decoded.depths, position)) for position in orbit(field, ORBIT)]
    return [
        MovieFrame("depth", with_scale(depth), DEPTH_MS),
        MovieFrame("nine views", views, HOLD_MS),
        MovieFrame("features and their distances, mm", with_features(decoded), HOLD_MS),
        *(MovieFrame("focus after capture", picture) for picture in (*focused, *focused[::-1])),
        *(MovieFrame("viewpoints in between", picture) for picture in around),
    ]


def coloured(inverse: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colours (h, w, 3) of inverse depths (h, w), 1/mm, from blue at `FAR_MM` to red at `NEAR_MM`."""
    part = (inverse - 1.0 / FAR_MM) / (1.0 / NEAR_MM - 1.0 / FAR_MM)
    level = np.rint(255.0 * np.clip(part * 0.9 + 0.06, 0.0, 1.0)).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(level, cv2.COLORMAP_TURBO), dtype=np.uint8)[..., ::-1]


def with_scale(depth: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Draw the scale of colours into a picture of depth (h, w, 3)."""
    height, width = depth.shape[0] // 2, 10
    page = Image.fromarray(np.ascontiguousarray(depth))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(LABEL_PX)
    left, top = page.width - 64, page.height // 4
    draw.rectangle((left - 8, top - 12, page.width, top + height + 28), fill="white")
    bar = coloured(np.linspace(1.0 / NEAR_MM, 1.0 / FAR_MM, height)[:, None].repeat(width, axis=1))
    page.paste(Image.fromarray(np.ascontiguousarray(bar)), (left, top))
    for depth_mm in (300, 350, 400, 500, 600):
        part = (1.0 / NEAR_MM - 1.0 / depth_mm) / (1.0 / NEAR_MM - 1.0 / FAR_MM)
        draw.text((left + width + 4, top + part * height), f"{depth_mm}", fill="#333", font=font, anchor="lm")
    draw.text((page.width - 12, top + height + 24), "mm", fill="#333", font=font, anchor="rb")
    return np.asarray(page)


def with_features(decoded: DecodedFrame) -> NDArray[np.uint8]:
    """Draw the features into the central view, coloured by their distance, which is written beside some of them."""
    features, field = decoded.features, decoded.light_field
    page = Image.fromarray(rgb(field.samples[reference_index(field)]))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(LABEL_PX)
    colours = coloured(1.0 / features.depth_mm[None])[0]
    labelled: list[int] = []
    for index in np.argsort(features.depth_sigma_mm):
        x, y = features.pixels[index]
        draw.circle((x, y), 4, outline=tuple(colours[index].tolist()), width=2)
        apart = np.abs(features.pixels[labelled] - (x, y)) > (70, 30)
        if len(labelled) < LABELS and apart.any(axis=1).all() and x < field.width_px - 40:
            labelled.append(int(index))
    for index in labelled:
        (x, y), text = features.pixels[index], f"{features.depth_mm[index]:.0f}"
        draw.text((x + 8, y), text, fill="white", font=font, anchor="lm", stroke_width=2, stroke_fill="#222")
    return np.asarray(page)


def write_movie(path: Path, frame: NDArray[np.uint8], frames: list[MovieFrame]) -> None:
    """Write an endless WebP: the camera's frame at the left, what is computed from it at the right."""
    height, width = frames[0].picture.shape[:2]
    font = ImageFont.load_default(FONT_PX)
    left = Image.fromarray(np.asarray(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8))
    pages = []
    for shown in frames:
        page = Image.new("RGB", (2 * width + GAP_PX, height + CAPTION_PX), "white")
        page.paste(left, (0, 0))
        page.paste(Image.fromarray(np.ascontiguousarray(shown.picture)), (width + GAP_PX, 0))
        draw = ImageDraw.Draw(page)
        for x, text in ((0, "one rendered frame of a webcam facing nine mirrors"), (width + GAP_PX, shown.caption)):
            draw.text((x + width / 2, height + CAPTION_PX / 2 + 2), text, fill="#333", font=font, anchor="mm")
        pages.append(page)
    file = BytesIO()
    durations = [shown.duration_ms for shown in frames]
    pages[0].save(
        file, "WEBP", save_all=True, append_images=pages[1:], duration=durations, loop=0, quality=QUALITY, method=4
    )
    write_bytes(path, file.getvalue())


def previews() -> NDArray[np.uint8]:
    """Draw the same objects as designs see them, a row for each: frame, central view, nearest depth in focus, depth."""
    lines = []
    layouts = [design(spec) for spec in PREVIEWED]
    for layout in layouts:
        frame = preview_frame(layout, width_px=PREVIEW_PX, arranged_for=layouts[0])
        products = preview_products(frame)
        central = products.light_field.samples[reference_index(products.light_field)]
        focused = products.refocused(min(PREVIEWED[0].depths_mm))
        cells = []
        for cell in (frame.picture, central, focused, products.depth_picture()):
            size = round(cell.shape[1] * ROW_PX / cell.shape[0]), ROW_PX
            cells.append(_on_white(np.asarray(cv2.resize(cell, size, interpolation=cv2.INTER_AREA)), size[0] + GAP_PX))
        lines.append(np.concatenate(cells, axis=1)[:ROW_PX])
    width = max(line.shape[1] for line in lines)
    return np.concatenate([_on_white(line, width) for line in lines])


def _on_white(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Extend a picture (h, w, 3) to a width, and by a gap below."""
    height = picture.shape[0]
    page = np.full((height + GAP_PX, width, 3), 255, np.uint8)
    page[:height, : picture.shape[1]] = picture
    return page


def main() -> None:
    """Copy the frame and the layout, and make the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("output/tour"))
    scene: Path = parser.parse_args().work / "tabletop"
    shipped = Path(demo.__path__[0])
    shutil.copyfile(scene / "frames/0000.jpg", shipped / "frame.jpg")
    shutil.copyfile(scene / "truth/layout.json", shipped / "layout.json")
    shutil.copyfile(scene / OVERVIEW, IMAGES / "tabletop.jpg")
    decoded = DecodedFrame.of(shipped / "frame.jpg", shipped / "layout.json")
    write_movie(IMAGES / MOVIE, read_image(shipped / "frame.jpg"), movie_frames(decoded))
    write_image(IMAGES / "preview.jpg", previews())


if __name__ == "__main__":
    main()
