"""Bought hardware, fits, printer and print settings: the one table of dimensions from which parts are made.

A TOML file may replace any entry except the print settings. A camera's body comes from the library of cameras
(`optics/geometry/cameras/`) or from its own file. Lengths in mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator
from shapely import Polygon

from mirrorcam.cad.plan.back_table import AnyBack, DeskBack
from mirrorcam.cad.plan.prices import Prices
from mirrorcam.cad.plan.threads import FITTINGS, THREADS
from mirrorcam.core.bounds import PART_GAP_MM, PART_MM, Bounds
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import Name
from mirrorcam.core.values import Value, with_tuples
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_body import CameraBody
from mirrorcam.optics.geometry.camera_library import profile_of, read_body
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_stock import WIDTH_TO_THICKNESS, Material, material_of

# Relative difference of the tangents of the half fields of view up to which two cameras count as the same model.
SAME_CAMERA_TOLERANCE = 0.1

_Size = Annotated[float, PART_MM.limits]


_positive = PART_MM.field

Speeds = Literal["ordinary", "careful"]


class Fits(Value):
    """Gaps between parts, on each side, for all printed parts."""

    press_mm: float = PART_GAP_MM.field(0.1, "gap of a press fit, which holds by itself")
    slide_mm: float = _positive(0.2, "gap of a sliding fit")
    free_mm: float = _positive(0.3, "gap of a free fit, such as a mirror in its pocket")
    light_mm: float = _positive(0.2, "gap between any part and the light, for print errors")


class Printer(Value):
    """The printer's limits, and its plastic."""

    bed_mm: tuple[_Size, _Size, _Size] = Field(default=(220.0, 220.0, 250.0), description="largest part, z up")
    wall_mm: float = _positive(0.9, "thinnest wall that prints: two lines of a 0.4 mm nozzle, each 0.45 mm wide")
    floor_mm: float = _positive(0.6, "thinnest level floor that prints: three layers")
    overhang_deg: float = Bounds(1.0, 89.0).field(
        45.0, "largest angle of an overhang from upright that prints without support"
    )
    bridge_mm: float = _positive(10.0, "longest flat ceiling between two walls")
    speeds: Speeds = Field(
        default="ordinary",
        description="speeds and acceleration of the print profile, and of the stated times: of printers sold since "
        "about 2020, or careful ones for older printers",
    )
    plastic: Name = Field(default="PLA", description="printed plastic")
    plastic_g_per_cm3: float = Bounds(0.01, 30.0).field(1.24, "density of the plastic")
    plastic_strength_mpa: float = Bounds(0.1, 1e4).field(
        50.0,
        "tensile strength of the plastic as moulded (PLA: 50 to 60 MPa in data sheets), of which screws use a quarter",
    )
    plastic_mpa: float = Bounds(1.0, 1e6).field(
        2300.0, "modulus of elasticity of the plastic as printed (PLA: 2.2 to 2.4 GPa in data sheets)"
    )
    plastic_creep: float = Bounds(0.0, 10.0).field(
        0.5, "additional strain after 1000 h under a constant small stress, as a multiple of the elastic strain"
    )
    plastic_strain: float = Bounds(1e-4, 0.2).field(
        0.0055,
        "largest strain of a leaf spring that stays bent: a quarter of the yield strain (PLA: 50 MPa / 2300 MPa = "
        "2.2 %; PETG: 0.01)",
    )


# Ratio of the largest diameter of a knurled head to a plain head's (ISO 4762).
KNURLING_MM = 0.2
# Length of engagement in an insert or a nut, in diameters of the thread.
ENGAGED_DIAMETERS = 2.5 / 3.0
# Space for melted plastic under an insert.
MELT_MM = 1.0


def _fields_of(thread: str) -> dict[str, Any]:
    """The fields of the screws of a thread, from the tables of threads."""
    size, fittings = THREADS[thread], FITTINGS[thread]
    washer, insert = fittings.washer_mm, fittings.insert_mm
    return {
        "thread": thread,
        "clearance_hole_mm": size.clearance_mm,
        "head_mm": round(size.head_mm + KNURLING_MM, 1),
        "head_height_mm": size.head_height_mm,
        "washer_mm": washer[0],
        "washer_height_mm": washer[1],
        "insert_hole_mm": insert[0],
        "insert_mm": insert[1],
        "insert_depth_mm": insert[1] + MELT_MM,
        "insert_wall_mm": insert[2],
        "nut_flats_mm": size.nut_flats_mm,
        "nut_height_mm": size.nut_height_mm,
        "engaged_mm": round(ENGAGED_DIAMETERS * size.diameter_mm, 1),
        "lengths_mm": fittings.lengths_mm,
    }


_M3 = _fields_of("M3")


class Fastening(Value):
    """The screws between parts and their threads: heat-set inserts or captive nuts.

    Dimensions that are not given are the thread's; a thread that is not given is the largest that passes
    `clearance_hole_mm`. The defaults below are for M3.
    """

    kind: Literal["insert", "nut"] = Field(default="insert", description="thread of the screws in a part")
    thread: Literal["M2", "M2.5", "M3", "M4"] = Field(default="M3", description="thread of all screws between parts")
    clearance_hole_mm: float = _positive(_M3["clearance_hole_mm"], "clearance hole (ISO 273, normal)")
    head_mm: float = _positive(_M3["head_mm"], "diameter of a socket cap head (ISO 4762)")
    head_height_mm: float = _positive(_M3["head_height_mm"], "height of the head")
    washer_mm: float = _positive(_M3["washer_mm"], "outer diameter of a washer (ISO 7089)")
    washer_height_mm: float = _positive(_M3["washer_height_mm"], "thickness of the washer")
    washer_under_mm: float = PART_GAP_MM.field(2.0, "thickest plastic on which a head needs a washer")
    insert_hole_mm: float = _positive(_M3["insert_hole_mm"], "hole for a heat-set insert (M3: outer diameter 4.6)")
    insert_mm: float = _positive(_M3["insert_mm"], "length of a heat-set insert")
    insert_depth_mm: float = _positive(
        _M3["insert_depth_mm"],
        "smallest depth of the hole: the insert and 1 mm for melted plastic; deeper where the screws need it",
    )
    insert_sink_mm: float = PART_GAP_MM.field(0.1, "how far an insert may sit below the face; never above it")
    insert_wall_mm: float = _positive(_M3["insert_wall_mm"], "material around an insert or a nut")
    nut_flats_mm: float = _positive(_M3["nut_flats_mm"], "width of a nut across flats (ISO 4032)")
    nut_height_mm: float = _positive(_M3["nut_height_mm"], "height of the nut")
    engaged_mm: float = _positive(
        _M3["engaged_mm"], "minimum thread engagement in an insert: 0.8 diameters, as in a steel nut"
    )
    lengths_mm: tuple[_Size, ...] = Field(
        default=_M3["lengths_mm"], min_length=1, description="lengths of screws at hand (ISO 4762)"
    )

    @model_validator(mode="before")
    @classmethod
    def _of_thread(cls, fields: Any) -> Any:
        """Fill in the dimensions of the thread."""
        if not isinstance(fields, dict):
            return fields
        hole = fields.get("clearance_hole_mm")
        passing = [name for name in FITTINGS if isinstance(hole, int | float) and THREADS[name].diameter_mm < hole]
        thread = fields.get("thread", passing[-1] if passing else "M3")
        return with_tuples(_fields_of(thread) | fields if thread in FITTINGS else fields)

    @model_validator(mode="after")
    def _check(self) -> Self:
        diameter = THREADS[self.thread].diameter_mm
        if self.clearance_hole_mm <= diameter:
            raise ValueError(
                f"clearance_hole_mm {self.clearance_hole_mm:g}, expected more than {diameter:g}: the screws are "
                f"{self.thread}"
            )
        if self.kind == "insert" and self.insert_mm < self.engaged_mm:
            raise ValueError(
                f"insert_mm {self.insert_mm:g}, expected at least engaged_mm, {self.engaged_mm:g}: a shorter insert "
                f"does not hold {self.thread} screws"
            )
        return self


class CompressionSpring(Value):
    """A stock cylindrical compression spring of steel, round a screw between holder and carrier."""

    wire_mm: float = _positive(0.5, "diameter of the wire")
    mean_mm: float = _positive(4.0, "mean diameter of the coils, which the screw passes through")
    free_mm: float = _positive(7.0, "free length")
    coils: float = Bounds(1.0, 100.0).field(3.5, "number of active coils")

    @property
    def n_per_mm(self) -> float:
        """Spring rate, G d^4 / (8 D^3 n) (EN 13906-1), for spring steel with G = 81.5 GPa."""
        return 81500.0 * self.wire_mm**4 / (8.0 * self.mean_mm**3 * self.coils)

    @property
    def solid_mm(self) -> float:
        """Solid length, with two inactive coils and ground ends."""
        return (self.coils + 2.0) * self.wire_mm

    @property
    def size(self) -> str:
        """Wire diameter, mean diameter and free length, for orders."""
        return f"{self.wire_mm:g} x {self.mean_mm:g} x {self.free_mm:g}"


class HolderDimensions(Value):
    """Dimensions of the mirror holder that do not follow from the layout."""

    mirrors: Literal["glue", "tape", "screws"] = Field(
        default="glue",
        description="how mirrors are mounted: glued to their seats, on the three pads of their seats by double-sided "
        "tape, or each glued to a carrier that three sprung screws from behind draw to the holder and tilt",
    )
    tape_mm: float = Bounds(0.02, 1.0).field(
        0.2, "thickness of the tape: a film with adhesive on both sides, not foam, which creeps and sets no distance"
    )
    tape_pad_mm: float = _positive(
        5.0, "diameter of the pads under tape, and width of the squares of tape; by default wider under heavy mirrors"
    )
    adjust_deg: float = Bounds(0.1, 3.0).field(
        1.0, "range of tilt of a mirror on screws, plus or minus, about any axis"
    )
    adjust_mm: float = PART_GAP_MM.field(0.3, "additional range along the screws' axes, plus or minus")
    carrier_inset_mm: float = _positive(0.5, "distance of a carrier's edge inside the edge of its mirror")
    spring: CompressionSpring = CompressionSpring()
    floor_mm: float = _positive(3.0, "thinnest material behind a mirror: stiff enough to stay flat")
    rim_mm: float = _positive(1.8, "width of the rim outside a pocket")
    rim_length_mm: float = _positive(3.0, "shortest piece of rim worth printing")
    rim_height_of_sheet: float = Field(
        default=0.6, gt=0, lt=1, description="height of the rim per thickness of the sheet"
    )
    mount_step_mm: float = _positive(2.0, "step of the search for the rectangle of mount holes")
    mount_of_width: float = Field(
        default=0.36,
        gt=0,
        lt=1,
        description="largest width of this rectangle per width of the holder: narrow mounts are light",
    )
    bond_mm: float = Bounds(0.02, 1.0).field(
        0.2,
        "height of a seat's three pads, which is the thickness of the glue, if any: at least one layer of the printer",
    )
    glue_pad_mm: float = _positive(2.0, "diameter of the pads of a mirror that is glued")
    groove_mm: float = _positive(1.0, "width of a groove for surplus glue")
    groove_depth_mm: float = _positive(0.6, "depth of a groove below the seat")
    groove_pitch_mm: float = _positive(7.0, "pitch of the grooves")
    shade_mm: float = _positive(0.9, "thickness of the baffle's walls against stray light")
    hood_mm: float = PART_GAP_MM.field(
        0.0,
        "height of the baffle over the highest mirror where it blocks no light, as a hood against light and dust from "
        "the sides; 0: only as high as the camera sees past the mirrors",
    )
    shade_out_mm: float = PART_GAP_MM.field(
        0.7, "how far the baffle stands outside the rims: if less than its thickness, no slit remains"
    )
    shade_step_mm: float = _positive(5.0, "length of the baffle's straight pieces")
    dust_cover: bool = Field(default=False, description="print a cap for the mirrors, where it fits the bed")
    pin_mm: tuple[_Size, _Size] = Field(default=(3.0, 16.0), description="diameter and length of pins that join pieces")
    depth_without_spec_mm: float = _positive(500.0, "working distance of a layout without a spec")

    @property
    def pad_mm(self) -> float:
        """Diameter of the pads, which carry the mirror."""
        return self.tape_pad_mm if self.mirrors == "tape" else self.glue_pad_mm

    @property
    def on_pads_mm(self) -> float:
        """Distance of a mirror's back from the pads: the thickness of the tape; 0 without."""
        return self.tape_mm if self.mirrors == "tape" else 0.0

    @property
    def bonded_share(self) -> float:
        """Share of a pad's area that tape reaches: the depth of the adhesive under its film over the height of a stair.

        A pad that is inclined to the layers prints as stairs, on whose edges the film rests.
        """
        return min(1.0, self.tape_mm / 2.0 / PRINT_SETTINGS.layer_mm)


class MountDimensions(Value):
    """The mount between camera and mirror holder: two skins with a truss of webs between them."""

    skin_mm: float = _positive(0.9, "smallest thickness of both skins")
    grip_mm: float = _positive(3.0, "thickness of the skin round the holder's screws, which it bends least")
    slide_skin_mm: float = _positive(4.0, "thickness of the skin round the screws of the clip")
    web_mm: float = _positive(0.9, "smallest thickness of the webs between the skins")
    deepest_mm: float = _positive(80.0, "largest depth of the mount, from skin to skin")
    clearance_mm: float = _positive(1.0, "gap between mount and mirror holder, except at its back")
    tilt_deg: float = Bounds(1e-4, 45.0).field(
        0.05,
        "largest tilt of the mirrors under gravity when the device changes its attitude: a sixth of a hobbyist's "
        "tolerance of one mirror; calibration absorbs the constant part",
    )
    cable_window_mm: tuple[_Size, _Size] = Field(
        default=(18.0, 10.0), description="width and height of the window for the cable: a USB plug passes through"
    )
    tie_mm: tuple[_Size, _Size] = Field(
        default=(4.0, 2.0), description="width and height of the slots for the cable tie next to the window"
    )


class ClipDimensions(Value):
    """The camera clip, which slides along the mount."""

    wall_mm: float = _positive(4.0, "thickness of walls, lips and the floor under a bare board")
    travel_mm: float = _positive(4.0, "travel of the clip from the nominal depth of the pupil, plus or minus")
    behind_mm: float = _positive(1.5, "gap between the body's back and the leaf behind it")
    shaken_g: float = Bounds(0.1, 100.0).field(
        3.0, "largest acceleration, as a multiple of gravity, at which the camera stays in contact with its six points"
    )
    rib_mm: float = _positive(2.0, "height of the V rib that guides the clip")
    screws_apart_mm: float = _positive(40.0, "distance between the clip's screws across the slide")
    screws_above_mm: float = _positive(
        18.0, "distance between their two rows along the slide; a clip too low for two rows has one"
    )


class Cutting(Value):
    """The stock sheet of the mirrors and how it is cut: acrylic by laser, glass by a wheel or a water jet."""

    material: Material = Field(
        default="glass",
        description="material of the mirrors, by default that of the refractive index that they are designed with; "
        "glass is cut along the lines, without a kerf",
    )
    sheet_mm: tuple[_Size, _Size] = Field(default=(300.0, 200.0), description="width and height of a sheet")
    kerf_mm: float = PART_GAP_MM.field(0.2, "full width of the laser's cut")
    gap_mm: float = Field(
        default=3.0, gt=0.5, le=PART_MM.max, description="gap between mirrors on the sheet, and from them to its edge"
    )
    mark_mm: float = _positive(5.0, "height of the mark on the back of a mirror")
    chamfer_mm: float = PART_GAP_MM.field(0.2, "width of the bevel ground on the edges of glass")

    @property
    def allowance_mm(self) -> float:
        """Distance of the cut files' lines outside the finished edge."""
        return self.kerf_mm / 2.0 if self.material == "acrylic" else 0.0

    def stock(self, surface: str, thickness_mm: float) -> str:
        """The name of a mirror's stock in parts list, guide and cut files: "first-surface acrylic mirror, 1 mm"."""
        return f"{surface}-surface {self.material} mirror, {thickness_mm:g} mm"

    @property
    def min_width_to_thickness(self) -> float:
        """Smallest ratio of a mirror's width to its thickness."""
        return WIDTH_TO_THICKNESS[self.material]


def field_of_view(camera: Camera) -> str:
    """A camera's field of view along x and y, without distortion, as text: "70.4 x 43.3 deg"."""
    tangents = _half_view_tangents(camera)
    return " x ".join(f"{math.degrees(2.0 * math.atan(tangent)):.1f}" for tangent in tangents) + " deg"


def _half_view_tangents(camera: Camera) -> tuple[float, float]:
    return camera.width_px / camera.fx_px / 2.0, camera.height_px / camera.fy_px / 2.0


def require_same_camera(camera: Camera, body: CameraBody) -> None:
    """Raise InputError if a layout's camera has a different field of view from the camera of a body."""
    if body.field_of_view_deg is None:
        return
    stated = [math.tan(math.radians(angle) / 2.0) for angle in body.field_of_view_deg]
    tangents = _half_view_tangents(camera)
    if any(abs(tangent / other - 1.0) > SAME_CAMERA_TOLERANCE for tangent, other in zip(tangents, stated, strict=True)):
        expected = " x ".join(f"{angle:.1f}" for angle in body.field_of_view_deg)
        raise InputError(
            f"camera body {body.name} has a field of view of {expected} deg, but the layout's camera {camera.name} has "
            f"{field_of_view(camera)}: give the body of that camera (--body), or design for this one"
        )


def _named(camera: object) -> object:
    return read_body(camera) if isinstance(camera, str) else with_tuples(camera)


class Hardware(Value):
    """All dimensions of a device that do not follow from its layout, in mm.

    `read_model(Hardware, path)` reads them from a TOML file, which may give any part of the table. A camera is given by
    its name in the library of cameras, the path of a TOML file, or its body's own table.
    """

    fit: Fits = Fits()
    printer: Printer = Printer()
    screw: Fastening = Fastening()
    holder: HolderDimensions = HolderDimensions()
    mount: MountDimensions = MountDimensions()
    clip: ClipDimensions = ClipDimensions()
    cutting: Cutting = Cutting()
    back: AnyBack = Field(default=DeskBack(), description="adapter under the mount's foot, by its `kind`")
    prices: Prices = Prices()
    camera: Annotated[CameraBody, BeforeValidator(_named, json_schema_input_type=CameraBody | str)] = Field(
        default_factory=lambda: read_body("c920"), description="body, name in the library, or path of a TOML file"
    )

    def for_layout(self, layout: Layout) -> Hardware:
        """The hardware with the body of a layout's camera, and for its mirrors, unless these are given."""
        match = None if "camera" in self.model_fields_set else profile_of(layout.camera)
        return (self if match is None else self.replaced(camera=match.body)).for_mirrors_of(layout)

    def for_mirrors_of(self, layout: Layout) -> Hardware:
        """The hardware with the material of a layout's mirrors, and pads that bear them, unless these are given."""
        cutting, holder = self.cutting, self.holder
        if "material" not in cutting.model_fields_set:
            cutting = cutting.replaced(material=material_of(layout))
        if "tape_pad_mm" not in holder.model_fields_set:
            # Three octagons bear the heaviest mirror on the share that is bonded.
            density = MIRROR_DENSITIES[cutting.material]
            weight_n = max(mirror_weight_n(mirror, density) for mirror in layout.mirrors)
            area_mm2 = weight_n / (TAPE_STRESS_KPA / 1000.0) / holder.bonded_share / 3.0
            width = math.ceil(2.0 * math.sqrt(area_mm2 * math.sqrt(2.0))) / 2.0
            holder = holder.replaced(tape_pad_mm=max(holder.tape_pad_mm, width))
        return self.replaced(cutting=cutting, holder=holder)


MIRROR_DENSITIES: dict[Material, float] = {"acrylic": 1.19, "glass": 2.5}
"""Densities of mirrors in g/cm3."""
TAPE_STRESS_KPA = 1.7
"""Stress that acrylic tape bears for years: 4 square inches per pound, 3M's guideline for VHB."""


def mirror_weight_n(mirror: Mirror, density_g_per_cm3: float) -> float:
    """Weight of a mirror."""
    volume_mm3 = Polygon(mirror.outline_in_plane_mm).area * mirror.thickness_mm
    return float(density_g_per_cm3 * volume_mm3 * 1e-6 * 9.80665)


HARDWARE = Hardware()


@dataclass(frozen=True)
class PrintSettings:
    """Nozzle, layer height, number of perimeters (lines of a wall) and percentage of infill.

    Two perimeters are OrcaSlicer's default for the printers whose speeds are compared in `cad/write/slicer.py`.
    """

    nozzle_mm: float = 0.4
    layer_mm: float = 0.2
    perimeters: int = 2
    infill_percent: int = 10

    def plastic_mm(self, thickness_mm: float, wall_mm: float) -> float:
        """Thickness of plastic in an upright plate, which has a wall on either side and infill between them."""
        inside = max(thickness_mm - 2.0 * wall_mm, 0.0)
        return thickness_mm - (1.0 - self.infill_percent / 100.0) * inside


PRINT_SETTINGS = PrintSettings()
