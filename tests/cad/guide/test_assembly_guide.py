"""The assembly guide follows the plan: camera, screws, pins."""

from __future__ import annotations

import html
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from manifold3d import Manifold
from markdown_it import MarkdownIt
from shapely import Polygon

from mirrorcam.cad.assembly.bill import bill_of
from mirrorcam.cad.assembly.build_steps import STEPS, also_needed, tools_of
from mirrorcam.cad.assembly.catalogue import purchased_items
from mirrorcam.cad.assembly.components import item_components
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.checks.cut_outlines import check_cuts
from mirrorcam.cad.checks.exported_mesh import read_stl, solid_of
from mirrorcam.cad.guide.assembly_guide import camera_toml, focus_of
from mirrorcam.cad.guide.device_pictures import EDGE_TEXT, scale_edges
from mirrorcam.cad.mirrors.sheet_files import write_sheets
from mirrorcam.cad.parts.reclamping import repeatability
from mirrorcam.cad.plan.back_table import Gen2Back
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.hardware import HARDWARE, Cutting, Hardware
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.plan.seats import Frustum, mirror_prism, outline_at
from mirrorcam.cad.write.bill_of_materials import as_markdown
from mirrorcam.cad.write.slicer import LAYERS, NOZZLE
from mirrorcam.core.figures.figure_texts import TIMES
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror_gaps import edges_mm
from tests.cad.guide.conftest import Made, guide_of
from tests.cad.taped import TAPED


def test_the_guide_follows_the_plan(made: Made, tmp_path: Path) -> None:
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    assert [int(n) for n in re.findall(r"^## Step (\d+)", text, re.MULTILINE)] == list(range(1, 11))
    assert made.device.layout.identity in text
    assert "heat-set" in text
    for name in (picture.name for picture in made.pictures[4:]):
        assert f"(pictures/{name}.png)" in text
    hardware = Hardware.model_validate({"camera": "board_38", "screw": {"kind": "nut"}})
    device = plan_device(made.device.layout, hardware)
    guide_of(
        tmp_path, device, made.parts, (*made.components[: len(made.parts)], *item_components(purchased_items(device)))
    )
    other = (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert "heat-set" not in other
    assert "not compared with the layout's camera, which sees 70.4 x 43.3 deg" in other
    assert "not compared with" not in text


def test_every_screw_inside_the_mount_has_an_opening_behind_it_that_its_head_passes(made: Made) -> None:
    screw = made.device.hardware.screw
    wide = [cut for cut in made.device.mount.cuts if isinstance(cut, Bore) and 2.0 * cut.radius_mm > screw.head_mm]
    assert len(wide) >= len(made.device.holder.holes_in_mount_mm) + len(made.device.clip.slide_points)


def test_the_guide_and_the_parts_list_state_the_glue_that_fills_the_gap(made: Made) -> None:
    """The gap is measured: the space behind the mirrors, as thick as the bond, that the printed holder leaves free."""
    guide, bill = ((made.folder / name).read_text(encoding="utf-8") for name in ("guide.md", "bom.md"))
    bond = made.device.hardware.holder.bond_mm
    (holder,) = (part for part in made.parts if part.name == "mirror_holder")
    solid = solid_of(read_stl(holder.stl))
    gap_mm3 = 0.0
    for mirror in made.device.layout.mirrors:
        seat = outline_at(mirror, mirror.back_mm - bond)
        gap_mm3 += (Manifold.hull_points(np.vstack([seat, mirror_prism(mirror).base])) - solid).volume()
    stated = re.findall(r"not on the pads: ([0-9.]+) ml for all mirrors", guide)
    stated += re.findall(rf"\| ([0-9.]+) ml, {bond:g} mm behind every mirror \|", bill)
    assert len(stated) == 2
    assert [float(ml) for ml in stated] == pytest.approx([gap_mm3 / 1000.0] * 2, rel=0.2)


def test_the_guide_and_the_parts_list_state_three_squares_of_tape_for_each_mirror(made: Made, tmp_path: Path) -> None:
    device = plan_device(made.device.layout, TAPED)
    guide_of(tmp_path, device, made.parts, made.components)
    guide, bill = (tmp_path / "guide.md").read_text(encoding="utf-8"), as_markdown(bill_of(device, made.parts, ()))
    count, width = 3 * len(device.layout.mirrors), TAPED.holder.tape_pad_mm
    assert f"cut {count} squares of {width:g} mm" in guide
    assert f"{count} squares of {width:g} mm" in bill
    assert "silicone" not in guide


def test_commands_of_the_guide_name_the_layout_by_its_path(made: Made) -> None:
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    commands = re.findall(r"^mirrorcam .*$", text, re.MULTILINE)
    assert commands
    assert " layout.json " not in "".join(commands)


def test_solid_and_sliced_masses_are_labelled(made: Made, tmp_path: Path) -> None:
    bare = [part.replaced(checks={}) for part in made.parts]
    figures = {"print_g": Metric(value=1.25, unit="g"), "print_minutes": Metric(value=65.0, unit="min")}
    sliced = [part.replaced(checks=figures) for part in made.parts]
    rows = ((sliced, "mass sliced | time", "1 g | 1:05 h"), (bare, "mass solid", f"{bare[0].mass.mass_g:.0f} g"))
    for parts, head, row in rows:
        guide_of(tmp_path, made.device, parts, made.components)
        text = (tmp_path / "guide.md").read_text(encoding="utf-8")
        assert f"| number | part | file | {head} |" in text
        assert f"(parts/{parts[0].name}.3mf) | {row} |" in text
        assert ("install PrusaSlicer" in text) == (parts is bare)


def test_hostile_names_are_text_in_the_guide(made: Made, tmp_path: Path) -> None:
    name = "<img src=x onerror=alert(1)> [a](javascript:b) ```"
    hardware = made.device.hardware
    hardware = hardware.replaced(
        camera=hardware.camera.replaced(name=name),
        printer=hardware.printer.replaced(plastic=name),
        back=Gen2Back(name=name),
    )
    clamped = replace(made.device, hardware=hardware, back=plan_back(made.device.clip, made.device.mount, hardware))
    guide_of(tmp_path, clamped, made.parts, made.components)
    text = (tmp_path / "guide.md").read_text(encoding="utf-8")
    page = MarkdownIt("commonmark", {"html": True}).enable("table").render(text)
    assert "onerror=" not in re.sub(r"&lt;img src=x onerror=alert\(1\)&gt;", "", page)
    assert 'href="javascript' not in page
    # The fourth as TOML, to copy; the camera again as without a price; headings and search words of two filaments and
    # the camera.
    assert html.unescape(page).count(name) == 4 + 1 + 2 * 3


def test_the_guide_asks_for_the_settings_that_the_slicer_uses(made: Made) -> None:
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    settings = LAYERS | NOZZLE
    layer, nozzle = settings["layer_height"], settings["nozzle_diameter"]
    infill = settings["fill_density"].removesuffix("%")
    asked = f"nozzle {nozzle} mm, layers of {layer} mm, {settings['perimeters']} perimeters (walls), {infill} % infill"
    assert asked in text


@pytest.mark.parametrize(
    ("surface", "up", "other"),
    [("first", "the side without the coating", "painted"), ("second", "the painted side", "without the coating")],
)
def test_guide_notes_and_drawing_lay_the_same_face_up(
    made: Made, tmp_path: Path, surface: Literal["first", "second"], up: str, other: str
) -> None:
    """Read back from the files: the cutter's note, the guide, and the side from which outlines and marks are drawn."""
    mirrors = tuple(mirror.replaced(surface=surface) for mirror in made.device.layout.mirrors)
    layout = made.device.layout.replaced(mirrors=mirrors)
    write_sheets(tmp_path / "mirrors", layout, HARDWARE.cutting)
    guide_of(tmp_path, replace(made.device, layout=layout), made.parts, made.components)
    step = (tmp_path / "guide.md").read_text(encoding="utf-8").partition("## Step 3")[2].partition("## Step 4")[0]
    lines = (tmp_path / "mirrors" / "cutting.md").read_text(encoding="utf-8").splitlines()
    (note,) = [line for line in lines if line.startswith("- Lay the sheet down")]
    assert note.removeprefix("- Lay the sheet down with its ") in step
    assert f"BACK up ({up})" in note
    assert other not in note
    assert other not in step
    # From the back, outlines fit the files and arrows point up; from the front, neither is true.
    checks = check_cuts([tmp_path / "mirrors" / "mirrors.dxf"], layout, HARDWARE.cutting)
    assert checks["outline_error_um"].passed
    assert checks["arrow_error_deg"].passed


def test_the_guide_takes_its_steps_and_pictures_in_the_order_that_is_checked(made: Made) -> None:
    """`check_step_views` checks the table of steps, which the guide follows."""
    steps = re.split(r"^## Step (\d+): ", (made.folder / "guide.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert [int(number) for number in steps[1::2]] == list(range(1, len(STEPS) + 1))
    for step, text in zip(STEPS, steps[2::2], strict=True):
        told = re.search(r"[Tt]ake .*pictures .*in a folder `(\w+)`", text)
        assert (told[1] if told else "") == step.pictures
        joins_clip = ("camera_clip", "mount") in step.joins
        assert ("clip on the rib of the mount" in text) == joins_clip


@pytest.mark.parametrize("name", ["c920", "board_38"])
def test_the_camera_in_the_guide_is_a_file_that_can_be_read_back(name: str, tmp_path: Path) -> None:
    camera = read_body(name)
    (tmp_path / "mine.toml").write_text(camera_toml(camera), encoding="utf-8")
    assert read_body(str(tmp_path / "mine.toml")) == camera


def test_a_split_part_is_pinned_in_the_guide(made: Made, tmp_path: Path) -> None:
    pin = PurchasedItem("pin", "3", 16.0, np.eye(4), np.zeros(3), ("mirror_holder_1", "mirror_holder_2"))
    guide_of(tmp_path, made.device, made.parts, (*made.components, *item_components([pin, pin])))
    assert f"Press the pins (2 {TIMES} [3 x 16 pins](" in (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert "Press the pins" not in (made.folder / "guide.md").read_text(encoding="utf-8")


def test_the_guide_names_mirrors_of_a_pattern_by_their_numbers(made: Made, tmp_path: Path) -> None:
    layout = made.device.layout
    views = len(layout.mirrors)
    pattern = Pattern(name="zigzag", positions=np.column_stack([np.arange(views), np.arange(views) % 2]))
    device = plan_device(layout.replaced(rows=1, cols=views, pattern=pattern), made.device.hardware)
    guide_of(
        tmp_path, device, made.parts, (*made.components[: len(made.parts)], *item_components(purchased_items(device)))
    )
    text = (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert f"{views} mirrors (zigzag) above" in text
    assert "row" not in text.partition("## Step 5")[2].partition("## Step 6")[0].replace("arrow", "")


def test_glass_is_never_cut_by_a_laser_or_called_acrylic(made: Made, tmp_path: Path) -> None:
    """Guide, cut file and parts list name one material and nothing of the other."""
    device = replace(made.device, hardware=made.device.hardware.replaced(cutting=Cutting(material="glass")))
    (sheet,) = write_sheets(tmp_path / "mirrors", device.layout, device.hardware.cutting)
    guide_of(tmp_path, device, made.parts, made.components)
    guide = (tmp_path / "guide.md").read_text(encoding="utf-8")
    notes = (tmp_path / "mirrors" / "cutting.md").read_text(encoding="utf-8")
    bill = as_markdown(bill_of(device, made.parts, (sheet,)))
    for text in (guide, notes, bill):
        assert "first-surface glass mirror, 1 mm" in text
        assert "acrylic" not in text.replace("acrylic adhesive", "")
    for text in (guide, notes):
        assert "laser" not in text.replace("No laser: it cracks glass", "").replace("Glass is not cut by a laser", "")


@pytest.mark.parametrize(
    ("shape", "title", "expected"),
    [("rectangles", "cut", "a plan of straight cuts"), ("stock:30x20", "mark", "bought in the sizes that [bom.md]")],
)
def test_rectangles_are_cut_straight_or_bought(
    made: Made, tmp_path: Path, shape: str, title: str, expected: str
) -> None:
    layout = made.device.layout.replaced(spec=DesignSpec(rows=2, cols=2, shape=shape))
    device = replace(made.device, layout=layout)
    write_sheets(tmp_path / "mirrors", layout, HARDWARE.cutting)
    guide_of(tmp_path, device, made.parts, made.components)
    guide = (tmp_path / "guide.md").read_text(encoding="utf-8")
    step = guide.partition(f"## Step 3: {title} the mirrors")[2].partition("## Step 4")[0]
    assert expected in step
    assert ("laser" in step) == (title == "cut")
    width, height = edges_mm(layout.mirrors[0])[:2]
    assert (
        f"\n\n| mirror | width | height | corners |\n|---|---|---|---|\n| 0-0 | {width:.1f} | {height:.1f} | 4 |"
        in step
    )
    assert ("a spare mirror of" in guide) == (title == "mark")


def test_the_step_of_the_back_is_that_of_its_kind(made: Made, tmp_path: Path) -> None:
    """A desk device has its nut in that step, and nothing about an arm in its files."""
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    step = text.partition("screw on the desk foot")[2].partition("## Step")[0]
    assert f"1 {TIMES} [1/4-20 UNC hexagon nut](" in step
    for document in ("guide.md", "bom.md"):
        written = (made.folder / document).read_text(encoding="utf-8")
        assert not re.search(r"kinova|wrist|robot|\barm\b|xacro|clamp", written, re.IGNORECASE)
    assert not re.search("kinova|wrist", (made.folder / "index.html").read_text(encoding="utf-8"), re.IGNORECASE)
    hardware = made.device.hardware.replaced(back=Gen2Back())
    clamped = replace(made.device, hardware=hardware, back=plan_back(made.device.clip, made.device.mount, hardware))
    guide_of(tmp_path, clamped, made.parts, made.components)
    text = (tmp_path / "guide.md").read_text(encoding="utf-8")
    assert "clamp the device to the arm" in text
    assert "screw on the desk foot" not in text


def test_the_clips_upper_edge_stands_at_the_longest_mark(made: Made) -> None:
    """Engraving, clip and picture: the clip's upper edge and the mount's longest mark are at one height."""
    clip, mount = made.device.clip, made.device.mount
    marks = [corners_of([cut]) for cut in mount.cuts if isinstance(cut, Frustum) and len(cut.base) == 3]
    at_edge = [corners for corners in marks if corners[:, 0].max() > mount.half_width_mm]
    longest = max(at_edge, key=lambda corners: float(np.ptp(corners[:, 0])))
    height = float(longest[:, 2].min() + longest[:, 2].max()) / 2.0
    assert height == pytest.approx(clip.top_mm)
    assert corners_of(clip.pieces)[:, 2].max() == pytest.approx(clip.top_mm)
    for bar in scale_edges(made.device):
        assert float(bar[..., 2].min() + bar[..., 2].max()) / 2.0 == pytest.approx(height)
        assert bar[..., 0].max() == pytest.approx(mount.half_width_mm)
    (picture,) = (picture for picture in made.pictures if picture.name == "clip")
    assert [item.label for item in picture.items].count(EDGE_TEXT) == 1


def test_the_guide_states_the_figures_of_the_nest(made: Made) -> None:
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    repeats = repeatability(made.device.clip, made.device.layout, made.device.hardware)
    assert f"within {1000.0 * repeats.shift_mm:.0f} µm and {repeats.rotation_deg:.2f}°" in text


def test_the_focus_is_set_at_the_distance_of_the_design_before_the_first_picture(made: Made, tmp_path: Path) -> None:
    """The guide states a layout's best focus, else the camera's focus, before the first picture is taken."""
    best = made.device.layout.replaced(metrics={"best_focus_mm": Metric(value=436.05, unit="mm")})
    assert focus_of(best) == 436.05
    assert focus_of(made.device.layout.replaced(metrics={})) == made.device.layout.camera.focus_mm
    guide_of(tmp_path, replace(made.device, layout=best), made.parts, made.components)
    step = (tmp_path / "guide.md").read_text(encoding="utf-8").partition("## Step 7")[2].partition("## Step 8")[0]
    set_at, board, pictures = (
        step.index(words) for words in ("**Set the focus now**, at 436 mm", "Print it at 100 %", "Take the pictures")
    )
    assert set_at < board < pictures


def test_the_guide_says_which_screw_goes_where(made: Made) -> None:
    """Of the bought screws in the clip, the one behind the back is along the lens axis, the other at the corner."""
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    screws = [item for item in purchased_items(made.device) if item.kind == "screw" and item.joins == ("camera_clip",)]
    upright = {abs(item.rig_from_item[2, 2]) > 0.99: f"M3 x {item.length_mm:g} screw" for item in screws}
    assert len(upright) == 2
    assert upright[True] != upright[False]
    assert f"the {upright[False]} at the far corner, the {upright[True]} behind the back" in text


def test_the_guide_and_the_parts_list_have_the_same_tools(made: Made) -> None:
    guide, bill = ((made.folder / name).read_text(encoding="utf-8") for name in ("guide.md", "bom.md"))
    opening = guide.partition("## Step 1")[0]
    for tool in tools_of(made.device, purchased_items(made.device)):
        assert tool.name in opening
        assert f"| - | Tool: {tool.name} |  | {tool.purpose} | - |" in bill
    for other in also_needed(made.device, purchased_items(made.device)):
        assert other.name in opening
        assert f"| - | Also needed: {other.name} |  | {other.purpose} | - |" in bill


def test_every_measure_of_the_cameras_file_is_in_the_guide(made: Made) -> None:
    """The same step measures or explains every number of the file to copy."""
    step = (made.folder / "guide.md").read_text(encoding="utf-8").partition("## Step 2")[0]
    told, _, file = step.partition("```toml")
    spoken = {"width_mm": "width", "height_mm": "height", "depth_mm": "depth", "mass_g": "mass without cable"}
    spoken |= {"lens_ring_mm": "lens ring", "lens_protrusion_mm": "above the front", "pupil_behind_front_mm": "pupil"}
    fields = set(re.findall(r"^(\w+_(?:mm|g)) =", file, re.MULTILINE))
    assert {"hinge_mm", "foot_mm", "lip_mm", "end_radius_mm"} < fields
    assert [field for field in fields if spoken.get(field, f"`{field}`") not in told] == []


def test_the_picture_is_checked_once_the_device_stands(made: Made, tmp_path: Path) -> None:
    """Nothing supports the device before the step of its back, after which come the live picture and the cover."""
    cover = made.parts[-1].replaced(name="dust_cover", number="MC-07")
    guide_of(tmp_path, made.device, (*made.parts, cover), made.components)
    text = (tmp_path / "guide.md").read_text(encoding="utf-8")
    places = [text.index(words) for words in ("Screw the desk foot", "(pictures/live_view.png)", "Put the dust cover")]
    assert places == sorted(places)


def test_the_glue_has_the_time_that_its_air_needs(made: Made) -> None:
    """Glue cures by 2 to 3 mm a day, up to the radius of the largest circle in a mirror."""
    text = (made.folder / "guide.md").read_text(encoding="utf-8")
    far, least, most = map(int, re.findall(r"is (\d+) mm from its edge, which takes (\d+) to (\d+) days", text)[0])
    widest = max(Polygon(mirror.outline_in_plane_mm).minimum_clearance for mirror in made.device.layout.mirrors)
    assert far == pytest.approx(widest / 2.0, abs=3.0)
    assert (least, most) == (math.ceil(far / 3), math.ceil(far / 2))
