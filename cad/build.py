"""From a layout to a folder of files that a maker can print and cut, each read back and checked."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from cad.hardware import HARDWARE, Hardware
from cad.holder.plan import plan_holder
from optics.files import write_metrics
from optics.layout import Layout
from optics.values import InputError, Metric

EXTRA = ("build123d", "OCP", "trimesh", "manifold3d", "ezdxf")


def build(layout: Layout, out: Path, hardware: Hardware = HARDWARE) -> dict[str, Metric]:
    """Write mirror_holder.step/.stl/.svg/.png, mirrors.dxf and checks.json into `out`; returns the checks.

    A check that fails is a metric past its limit. Raises InputError where the layout cannot be built (which measure
    breaks), where the extra is not installed or `out` cannot be written; then no file appears.
    """
    body = plan_holder(layout, hardware)
    try:
        from cad.checks import check_files
        from cad.cutting import write_dxf
        from cad.exports import write_step, write_stl
        from cad.holder.solid import check_gaps, make_holder
        from cad.picture import write_drawing, write_picture
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in EXTRA:
            raise
        raise InputError(f'{error.name} is not installed, needed to build parts: pip install -e ".[cad]"') from None
    check_gaps(layout, hardware)
    part = make_holder(body)
    try:
        out.mkdir(parents=True, exist_ok=True)
        scratch = TemporaryDirectory(dir=out, prefix=".cad-")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from None
    with scratch as name:
        folder = Path(name)
        write_step(folder / "mirror_holder.step", part)
        write_stl(folder / "mirror_holder.stl", part)
        write_dxf(folder / "mirrors.dxf", layout, hardware)
        write_drawing(folder / "mirror_holder.svg", part, layout)
        write_picture(folder / "mirror_holder.png", folder / "mirror_holder.stl", layout)
        checks = check_files(folder, layout, hardware)
        volume = checks["volume_cm3"].value
        bed_width, bed_length = sorted(hardware.printer.bed_mm[:2])
        width, length = sorted(body.size_mm[:2])
        checks |= {
            "solid_mass_g": Metric(value=volume * hardware.printer.plastic_g_per_cm3, unit="g"),
            "print_length_mm": Metric(value=length, unit="mm", limit=bed_length),
            "print_width_mm": Metric(value=width, unit="mm", limit=bed_width),
            "print_height_mm": Metric(value=body.size_mm[2], unit="mm", limit=hardware.printer.bed_mm[2]),
        }
        write_metrics(folder / "checks.json", checks)
        for file in sorted(folder.iterdir()):
            file.replace(out / file.name)
    return checks
