"""The table of dimensions: against the tables of another library, and from users' files.

The slicer settings that guide and slicer share.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from bd_warehouse.fastener import HeatSetNut, HexNut, PlainWasher, SocketHeadCapScrew

from mirrorcam.cad.plan.hardware import HARDWARE, PRINT_SETTINGS, Fastening, Hardware, require_same_camera
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import read_body


@pytest.mark.parametrize(
    ("thread", "pitch", "insert"), [("M2", "0.4", 3.0), ("M2.5", "0.45", 4.0), ("M3", "0.5", 5.7), ("M4", "0.7", 8.1)]
)
def test_fasteners_are_those_of_the_standards(thread: str, pitch: str, insert: float) -> None:
    """ISO 4762, ISO 4032, ISO 273, ISO 7089 and the insert's data sheet, from bd_warehouse."""
    ours = Fastening(thread=thread)
    size = f"{thread}-{pitch}"
    screw, nut = SocketHeadCapScrew(size, length=8.0, simple=True), HexNut(size, simple=True)
    assert ours.clearance_hole_mm == screw.clearance_hole_diameters["Normal"]
    assert ours.head_mm == pytest.approx(screw.screw_data["dk"], abs=0.05)
    assert ours.head_height_mm == screw.screw_data["k"]
    assert (ours.nut_flats_mm, ours.nut_height_mm) == (nut.nut_data["s"], nut.nut_data["m"])
    assert min(ours.lengths_mm) >= screw.screw_data["short"]
    assert max(ours.lengths_mm) <= screw.screw_data["long"]
    washer = PlainWasher(thread, fastener_type="iso7089").washer_data
    assert ours.washer_mm == washer["d2"]
    # bd_warehouse has the largest thickness of the standard; ours is nominal.
    assert ours.washer_height_mm == pytest.approx(washer["h"], abs=0.11)
    data = HeatSetNut.fastener_data[f"{size}-{insert:g}"]
    assert (ours.insert_hole_mm, ours.insert_mm) == tuple(float(data[f"CNCKitchen:{key}"]) for key in ("dc", "m"))
    assert ours.insert_wall_mm >= float(data["CNCKitchen:material_thickness"])


def test_a_thread_that_is_not_given_passes_the_clearance_hole() -> None:
    assert [Fastening(clearance_hole_mm=hole).thread for hole in (2.2, 2.9, 3.2, 4.5)] == ["M2", "M2.5", "M3", "M4"]
    assert Fastening(clearance_hole_mm=2.4, head_mm=4.0).nut_flats_mm == Fastening(thread="M2").nut_flats_mm
    with pytest.raises(InputError, match=r"clearance_hole_mm 3\.4, expected more than 4: the screws are M4"):
        Fastening(thread="M4", clearance_hole_mm=3.4)
    with pytest.raises(InputError, match=r"insert_mm 2, expected at least engaged_mm, 2\.5: .* hold M3 screws"):
        Fastening(insert_mm=2.0)


def test_a_file_replaces_any_entry_of_the_table(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('camera = "board_38"\n[screw]\nkind = "nut"\n[cutting]\nkerf_mm = 0.18\n', encoding="utf-8")
    hardware = read_model(Hardware, path)
    assert hardware.camera == read_body("board_38")
    assert (hardware.screw.kind, hardware.cutting.kerf_mm) == ("nut", 0.18)
    assert hardware.screw.replaced(kind="insert") == HARDWARE.screw
    assert hardware.printer == HARDWARE.printer


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[screw]\nkind = "glue"\n', r"mine\.toml: screw\.kind: Input should be 'insert' or 'nut'"),
        (
            "[printer]\nwall_mm = -1.0\n",
            r"mine\.toml: printer\.wall_mm: Input should be greater than or equal",
        ),
        ("[printers]\n", r"mine\.toml: printers: not known, did you mean printer"),
        (
            'camera = "c930"\n',
            r"mine\.toml: .*camera 'c930': expected one of .*, brio, c920, .*, or a \.toml file",
        ),
        ('camera = "nowhere.toml"\n', r"nowhere\.toml: no such file"),
    ],
)
def test_an_error_in_a_file_is_reported_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        read_model(Hardware, path)
    assert "\n" not in str(caught.value)


def test_a_body_of_a_different_camera_from_the_layouts_is_refused() -> None:
    camera, body = Camera.c920(), read_body("c920")
    require_same_camera(camera, body)
    require_same_camera(camera.replaced(fx_px=1.05 * camera.fx_px, fy_px=1.05 * camera.fy_px), body)
    other = body.replaced(name="Pi HQ, 6 mm", field_of_view_deg=(55.3, 42.9))
    with pytest.raises(InputError, match=r"Pi HQ, 6 mm has a .* of 55\.3 x 42\.9 deg, .* C920 has 70\.4 x 43\.3 deg"):
        require_same_camera(camera, other)
    require_same_camera(camera, other.replaced(field_of_view_deg=None))  # older files omit it


def test_a_board_camera_may_stand_in_a_table_of_hardware(tmp_path: Path) -> None:
    body = read_body("board_38").model_dump(mode="json", exclude_none=True)
    (tmp_path / "hardware.json").write_text(json.dumps({"camera": body | {"field_of_view_deg": [60.0, 40.0]}}))
    camera = read_model(Hardware, tmp_path / "hardware.json").camera
    assert camera.held_by == read_body("board_38").held_by
    assert camera.field_of_view_deg == (60.0, 40.0)


def test_the_perimeters_print_the_thinnest_wall() -> None:
    assert PRINT_SETTINGS.perimeters * PRINT_SETTINGS.nozzle_mm <= HARDWARE.printer.wall_mm + 1e-9
    assert PRINT_SETTINGS.layer_mm < PRINT_SETTINGS.nozzle_mm
    assert 0 < PRINT_SETTINGS.infill_percent < 100
