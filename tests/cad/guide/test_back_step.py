"""The guide's step for what carries the device: its sentences follow from parts, items and support."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.blocks import TRIPOD
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.guide.back_step import back_sentences, tripod_note
from mirrorcam.cad.plan.back_table import BACKS, back_of


@pytest.mark.parametrize("kind", BACKS)
def test_every_item_and_support_has_its_sentence(device: Device, kind: str) -> None:
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=back_of(kind)))
    sentences = back_sentences(replace(device, back=back))
    text, note = " ".join(sentences), tripod_note(back)
    assert sum("to the foot of the mount from below" in sentence for sentence in sentences) == 1
    assert ("mirrorcam.xacro" in text) == (back.robot is not None)
    assert ("on a desk" in text) == (back.stand is not None)
    has_nut = any(item.size == TRIPOD for item in back.items)
    # The tripod's screw holds by what it protrudes beyond the plastic under the nut.
    assert ("holds with 3.9 mm" in text + note) == has_nut
    assert ("has no nut for a tripod" in note) == (not has_nut)
    assert "None" not in text + note and "  " not in text + note


def test_an_abbreviation_keeps_its_letters(device: Device) -> None:
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=back_of("vesa")))
    assert back_sentences(replace(device, back=back))[0].startswith("Screw the VESA bracket to")
