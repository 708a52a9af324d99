"""The assembly guide follows the plan: camera, screws, pins."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mirrorcam.cad.assembly.catalogue import bought_items
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.assembly.pieces import item_pieces
from mirrorcam.cad.documents.assembly_guide import write_guide
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem
from tests.cad.documents.conftest import Made


def test_the_guide_follows_the_plan(made: Made, tmp_path: Path) -> None:
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    assert [int(n) for n in re.findall(r"^## Step (\d+)", text, re.MULTILINE)] == list(range(1, 11))
    for word in ("heat-set", "lips", "row 0 is the", made.device.layout.identity, "Ø63"):
        assert word in text
    for name in (picture.name for picture in made.pictures[4:]):
        assert f"(pictures/{name}.png)" in text
    hardware = Hardware.model_validate({"camera": "board_38", "screw": {"kind": "nut"}})
    device = plan_device(made.device.layout, hardware)
    write_guide(tmp_path, device, made.parts, (*made.pieces[: len(made.parts)], *item_pieces(bought_items(device))))
    other = (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert "Set the board on the posts" in other
    assert "Slide each nut" in other
    assert "heat-set" not in other
    assert "soldering iron" not in other


def test_a_split_part_is_pinned_in_the_guide(made: Made, tmp_path: Path) -> None:
    pin = BoughtItem("pin", "3", 16.0, np.eye(4), np.zeros(3), ("mirror_holder_1", "mirror_holder_2"))
    write_guide(tmp_path, made.device, made.parts, (*made.pieces, *item_pieces([pin, pin])))
    assert "Press the pins (2 x 3 x 16 pin)" in (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert "Press the pins" not in (made.folder / "guide.md").read_text(encoding="utf-8")
