"""The hardware that a device is built from: a table of dimensions, and the choices that change most often."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from pydantic import Field

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.console.options import Adapter
from mirrorcam.core.values import Value

if TYPE_CHECKING:
    from mirrorcam.cad.plan.hardware import Hardware
    from mirrorcam.optics.geometry.layout import Layout

UNSET = "[default: as in --hardware, else {}]"


@Parameter(name="*")
class HardwareChoice(Value):
    """Options that replace the default hardware of a device."""

    hardware: Annotated[Path | None, Parameter(metavar="FILE")] = Field(
        default=None,
        description="hardware.toml, whose values replace the table of dimensions (docs/cad.md)",
    )
    body: Annotated[str | None, Parameter(metavar="NAME|FILE")] = Field(
        default=None,
        description="body of the camera: a name that mirrorcam camera list prints, or a TOML file. "
        + UNSET.format("the layout's"),
    )
    adapter: Annotated[Adapter | Path | None, Parameter(metavar="KIND|FILE")] = Field(
        default=None,
        description="part that carries the device: on a desk, a tripod, an arm or others (docs/cad.md), or a Python or "
        "STEP file "
        "with a part of your own (docs/own_back.md). " + UNSET.format("none"),
    )
    mounting: Literal["glue", "tape", "screws"] | None = Field(
        default=None,
        description="mounting of the mirrors: by glue or tape on the holder, or each on a carrier that three sprung "
        "screws tilt. " + UNSET.format("glue"),
    )

    look_deg: float | None = Bounds(-90.0, 90.0).field(
        None,
        "angle of the views above the horizon as the device stands, or above the axis of an arm's flange",
        unset="as in --hardware, else 0",
    )

    def read(self, layout: Layout | None = None) -> Hardware:
        """Read the hardware of a device.

        Unless `body` or the table states a body, it is that of the layout's camera in the library, otherwise the
        C920's. Unless the table states the mirrors' material, it is the layout's. An adapter of the same kind as the
        table's keeps its dimensions. Raises InputError for an invalid file.
        """
        from mirrorcam.cad.plan.back_table import FileBack, back_of
        from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
        from mirrorcam.core.disk.files import read_model
        from mirrorcam.optics.geometry.camera_library import read_body

        hardware = HARDWARE if self.hardware is None else read_model(Hardware, self.hardware)
        if self.body:
            hardware = hardware.replaced(camera=read_body(self.body))
        if layout is not None:
            hardware = hardware.for_layout(layout)
        if self.mounting:
            hardware = hardware.replaced(holder=hardware.holder.replaced(mirrors=self.mounting))
        if self.adapter and self.adapter != hardware.back.kind:
            back = back_of(str(self.adapter))
            if isinstance(back, FileBack) and hardware.back.kind == back.kind:
                back = hardware.back.replaced(file=back.file)
            hardware = hardware.replaced(back=back)
        if self.look_deg is not None:
            hardware = hardware.replaced(back=hardware.back.replaced(look_deg=self.look_deg))
        return hardware
