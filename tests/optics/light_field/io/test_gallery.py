"""Public light fields that the project does not ship, each read by one line where it is present.

A set is looked for in the folder of its name in $MIRRORCAM_LIGHT_FIELDS, as its source distributes it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from mirrorcam.optics.light_field.io.formats.registry import open_light_fields
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed


@dataclass(frozen=True)
class PublicSet:
    """A set: its folder and source, what its files do not state, and its rows, columns, width and height."""

    name: str
    source: str
    assumed: Assumed
    shape: tuple[int, int, int, int]
    notes: tuple[str, ...] = field(default=())


PARALLEL = float("inf")
SETS = (
    *(
        PublicSet(name, "HCI 4-D benchmark, every fourth view", NOTHING, (3, 3, 512, 512))
        for name in ("cotton", "dino", "greek")
    ),
    PublicSet(
        "antinous",
        "HCI 4-D benchmark without parameters.cfg, github.com/chshin10/epinet",
        Assumed(rows=9, cols=9, step_mm=10.0, focal_px=1000.0, reference_depth_mm=1000.0),
        (9, 9, 512, 512),
    ),
    PublicSet(
        "lytro_2067",
        "Lytro Illum, github.com/chshin10/epinet, lytro/2067",
        Assumed(step_mm=1.0, focal_px=500.0, reference_depth_mm=500.0),
        (9, 9, 552, 383),
    ),
    *(
        PublicSet(
            name,
            "Middlebury 2003, im2.png and im6.png, github.com/xland16/disparitymapping",
            Assumed(cols=2, step_mm=160.0, focal_px=900.0, reference_depth_mm=PARALLEL),
            (1, 2, 450, 375),
        )
        for name in ("cones", "teddy")
    ),
    PublicSet(
        "lf_gs",
        "nine views with a binary COLMAP model, github.com/yixuhuang72-hue/LF-GS, data",
        NOTHING,
        (3, 3, 541, 375),
        ("cameras turned by up to 9.5 deg",),
    ),
    PublicSet(
        "three_photos",
        "photographs of a phone with a COLMAP model as text, github.com/Brianmax/NeRF, colmap_text as sparse and fotos "
        "as images",
        NOTHING,
        (1, 3, 1152, 864),
        ("cameras turned by up to 12 deg",),
    ),
    PublicSet(
        "midd1",
        "Middlebury 2006, view0.png to view6.png, github.com/xylon-b/finalProj",
        Assumed(rows=1, step_mm=40.0, focal_px=3740.0, reference_depth_mm=PARALLEL),
        (1, 7, 1312, 1110),
        ("pictures left out",),
    ),
    PublicSet(
        "shop",
        "27 x 27 rendered views, here rows 9 to 13 and columns 11 to 15 by two, "
        "github.com/linusmossberg/light-field-renderer",
        Assumed(reference_depth_mm=PARALLEL),
        (3, 3, 960, 640),
    ),
    PublicSet(
        "lego",
        "Stanford gantry, rectified, lightfield.stanford.edu",
        Assumed(step_mm=10.0, focal_px=1000.0, reference_depth_mm=1000.0),
        (17, 17, 1024, 1024),
    ),
)


@pytest.mark.parametrize("public", SETS, ids=[public.name for public in SETS])
def test_a_public_set_is_read_by_one_line(public: PublicSet) -> None:
    named = os.environ.get("MIRRORCAM_LIGHT_FIELDS")
    if not named:
        pytest.skip("$MIRRORCAM_LIGHT_FIELDS names no folder of public light fields")
    path = Path(named) / public.name
    if not path.is_dir():
        pytest.skip(f"{path} is missing: {public.source}")
    contents = open_light_fields(path, assumed=public.assumed)
    (found,) = contents.frames
    assert (found.rows, found.cols, found.width_px, found.height_px) == public.shape
    assert found.valid.mean() > 0.5
    assert found.samples.min() < found.samples.max()
    assert len(contents.notes) == len(public.notes)
    for note, expected in zip(contents.notes, public.notes, strict=True):
        assert expected in note
