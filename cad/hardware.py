"""Bought hardware, fits and the printer, by name: the one table of dimensions that parts are drawn from."""

from __future__ import annotations

from pydantic import Field

from optics.values import Value


class Hardware(Value):
    """Dimensions that no layout changes. Lengths in mm."""

    mirror_fit_mm: float = Field(default=0.3, gt=0, description="gap around a mirror in its pocket (runs free)")
    light_fit_mm: float = Field(default=0.2, gt=0, description="gap between any part and the light, for print errors")
    wall_mm: float = Field(default=1.2, gt=0, description="thinnest wall that prints: three lines of a 0.4 mm nozzle")
    floor_mm: float = Field(
        default=3.0, gt=0, description="thinnest material behind a mirror: stiff enough to stay flat"
    )
    rim_mm: float = Field(default=1.8, gt=0, description="width of the rim outside a pocket")
    rim_length_mm: float = Field(default=3.0, gt=0, description="shortest piece of rim worth printing")
    rim_height_of_sheet: float = Field(default=0.6, gt=0, lt=1, description="height of the rim over sheet thickness")
    insert_hole_mm: float = Field(default=4.0, gt=0, description="hole for an M3 heat-set insert (outer diameter 4.6)")
    insert_depth_mm: float = Field(default=6.7, gt=0, description="insert of 5.7 mm and room for melted plastic")
    insert_wall_mm: float = Field(default=2.0, gt=0, description="material around an insert")
    mount_step_mm: float = Field(default=2.0, gt=0, description="steps in which the rectangle of mount holes is tried")
    cut_gap_mm: float = Field(default=3.0, gt=0.5, description="gap between mirrors on the sheet to be cut")
    mark_mm: float = Field(default=5.0, gt=0, description="height of the mark engraved on the back of a mirror")
    bed_mm: tuple[float, float, float] = Field(default=(220.0, 220.0, 250.0), description="what the printer can print")
    plastic_g_per_cm3: float = Field(default=1.24, gt=0, description="density of PLA")
    depth_without_spec_mm: float = Field(default=500.0, gt=0, description="working distance of a layout without a spec")


HARDWARE = Hardware()
