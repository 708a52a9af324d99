"""What decides about the files of a part: its plan, the printer, our code and the libraries that write it."""

from __future__ import annotations

from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from build123d import Part

from mirrorcam.cad import part_files
from mirrorcam.cad.plan.hardware import HARDWARE, Printer
from mirrorcam.cad.plan.part_plan import BuiltPart, MassProperties, PartPlan
from mirrorcam.core.disk.fingerprint import file_digest


def make_wedge(plan: object) -> Part:
    raise NotImplementedError(plan)


PART = PartPlan("wedge", "Wedge", "7", (1.0, 2.0), make_wedge, np.eye(4), np.zeros(3), (0.5, 0.5, 0.5))


@pytest.fixture(scope="module")
def key() -> str:
    return part_files._key(PART, Printer())


def test_another_version_of_a_library_is_another_part(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    now = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: "999" if name == "build123d" else now(name))
    assert part_files._key(PART, Printer()) != key


def test_a_slicer_that_is_installed_later_is_another_part(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(part_files, "slicer_version", lambda: "PrusaSlicer-99.0")
    assert part_files._key(PART, Printer()) != key


def test_other_numbers_are_another_part_and_the_same_numbers_the_same(key: str) -> None:
    assert part_files._key(replace(PART), Printer()) == key
    assert part_files._key(replace(PART, plan=(1.0, 2.5)), Printer()) != key
    assert part_files._key(PART, Printer(plastic_g_per_cm3=1.0)) != key
    assert part_files._key(PART, Printer(), HARDWARE.screw.replaced(kind="nut")) != key


def test_a_drawing_of_another_date_is_made_again(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert part_files._key(PART, Printer()) != key


@pytest.mark.parametrize(
    ("name", "taken"),
    [
        ("parts/wedge.step", True),
        ("drawings/wedge.svg", True),
        ("thesis.docx", False),
        ("parts/thesis.docx", False),
        ("mirrors/wedge.dxf", False),
        ("parts/deep/wedge.step", False),
        ("../wedge.step", False),
    ],
)
def test_a_record_hands_over_files_of_its_part_alone(name: str, taken: bool, key: str, tmp_path: Path) -> None:
    previous, out = tmp_path / "previous", tmp_path / "out"
    path = previous / name
    (previous / "parts").mkdir(parents=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("content")
    mass = MassProperties(volume_mm3=1.0, mass_g=1.0, centre_in_rig_mm=[0.0] * 3, inertia_g_mm2=np.eye(3).tolist())
    built = BuiltPart.of(PART, Path("parts"), mass, {})
    record = part_files._Record(key=key, files={name: file_digest(path)}, part=built)
    (previous / "parts" / ".wedge.json").write_text(record.model_dump_json())
    found = part_files._take_over(PART, key, out, previous)
    assert (found is not None) == taken
    assert (out / name).exists() == taken
