"""Make the pictures of docs/tour.md by its commands: `python -m docs.make_tour [--work FOLDER]`.

The page runs in the folder, by default output/tour, where finished results of an earlier run are kept. Above each
picture, a comment names the files that it is made of, which are placed side by side.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from docs.page_code import run_page
from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.images.pictures import encoded_image, read_image

TOUR = Path(__file__).with_name("tour.md")
MAX_WIDTH_PX = 1440
JPEG_QUALITY, MOVIE_QUALITY = 84, 60
GAP_PX = 6


@dataclass(frozen=True)
class Illustration:
    """Paths of a picture, from the tour, and of the files that it is made of, from the folder of the commands."""

    picture: str
    made_of: tuple[str, ...]


def illustrations(text: str) -> list[Illustration]:
    """The pictures of a tour, with the files that they are made of."""
    matches = re.findall(r"^(?:<!-- from (.+) -->\n)?!\[[^]]+\]\((.+)\)$", text, flags=re.MULTILINE)
    unknown = [picture for made_of, picture in matches if not made_of]
    if unknown:
        raise ValueError(f"{unknown}: no comment names the files that they are made of")
    return [Illustration(picture, tuple(made_of.split())) for made_of, picture in matches]


def illustrate(made_of: list[Path], picture: Path) -> None:
    """Write a picture: files side by side, no wider than `MAX_WIDTH_PX`, or an animation in another format."""
    if made_of[0].suffix == ".gif":
        with Image.open(made_of[0]) as animation:
            animation.save(picture, save_all=True, quality=MOVIE_QUALITY)
        return
    images = [read_image(path) for path in made_of]
    height = min(image.shape[0] for image in images)
    gap = np.full((height, GAP_PX, 3), 255, np.uint8)
    row = np.concatenate([part for image in images for part in (gap, image[:height])][1:], axis=1)
    if row.shape[1] > MAX_WIDTH_PX:
        size = MAX_WIDTH_PX, round(row.shape[0] * MAX_WIDTH_PX / row.shape[1])
        row = np.asarray(cv2.resize(row, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    write_bytes(picture, encoded_image(row, picture.suffix, JPEG_QUALITY))


def main() -> None:
    """Run the page, then write all pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("output/tour"))
    work: Path = parser.parse_args().work
    work.mkdir(parents=True, exist_ok=True)
    run_page(TOUR, work)
    for illustration in illustrations(TOUR.read_text(encoding="utf-8")):
        illustrate([work / name for name in illustration.made_of], TOUR.parent / illustration.picture)


if __name__ == "__main__":
    main()
