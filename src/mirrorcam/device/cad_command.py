"""`mirrorcam cad`: from a layout to parts, a picture of the device, and the turns of its screws."""

from __future__ import annotations

import glob
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import App, Parameter

from mirrorcam.core.console.options import Force, Workers
from mirrorcam.core.console.progress import long_work, print_metrics, print_table, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import SIGMA, count_text
from mirrorcam.device.hardware_choice import HardwareChoice

if TYPE_CHECKING:
    from mirrorcam.device.adjustment import MirrorTurns

PRINTED = ("device.", "mirrors.", "elastic.")
"""Prefixes of the names of checks that are printed even if they pass."""
SPP, JPEG_QUALITY = 64, 85
"""Samples per pixel of a picture of the device, and its JPEG quality."""
LayoutFile = Annotated[Path, Parameter(name="LAYOUT", help="layout.json")]
DeviceFolder = Annotated[Path, Parameter(name="DEVICE_FOLDER", help="folder that mirrorcam cad wrote for the device")]

app = App(name="cad")


@app.default
def cad(
    layout: LayoutFile,
    /,
    *,
    choice: HardwareChoice = HardwareChoice(),
    elastic: Annotated[
        bool,
        Parameter(
            help="also compute how gravity, temperature and creep move the mirrors, by finite elements "
            "(extra fe; minutes)"
        ),
    ] = False,
    workers: Workers = None,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/cad"),
    force: Force = False,
) -> int:
    """Generate and check every part of a device; render it; adjust its mirrors.

    Writes the files to print, cut, assemble and view: open index.html. Parts that have not changed since an earlier run
    are reused. Exit code 1: a check failed.

    Examples:
        mirrorcam cad output/mine/layout.json --out output/mine/cad
        mirrorcam cad layout.json --body d435 --adapter tripod --mounting screws
        mirrorcam cad picture layout.json output/cad
    """
    from mirrorcam.cad.plan.device_names import files_of
    from mirrorcam.cad.plan.hardware import field_of_view
    from mirrorcam.core.disk.output_folder import output_folder, results_folder
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.optics.geometry.layout import Layout

    device = Layout.load(layout)
    hardware = choice.read(device)
    if hardware.camera.field_of_view_deg is None:
        body, view = hardware.camera.name, field_of_view(device.camera)
        say("cad", f"camera body {body} states no field_of_view_deg: cannot compare it with the layout's, {view}")
    require("cad", *(("fe",) if elastic else ()))
    from mirrorcam.cad.build import build_parts

    task = f"a device of {count_text(len(device.mirrors), 'mirror')}"
    with long_work("cad", task, "steps") as advance, output_folder(out, "cad", force=force) as output:
        output.refuse_changed()
        output.refuse_others(*files_of(hardware, elastic=elastic))
        with output.staged(result="checks.json") as folder:
            checks = build_parts(
                device,
                folder,
                hardware,
                results=results_folder(out),
                workers=workers or cores(),
                progress=advance,
                elastic=elastic,
            )
    from mirrorcam.cad.plan.prices import summary_of

    failed = {name for name, check in checks.items() if not check.passed}
    print_metrics({"measured": {name: checks[name] for name in checks if name in failed or name.startswith(PRINTED)}})
    limited = sum(check.limit is not None for check in checks.values())
    verdict = f"{len(failed)} of {limited} checks failed" if failed else f"{limited} checks passed"
    figures = count_text(len(checks) - limited, "figure")
    say("cad", f"{summary_of(checks)}; prices are estimates, see {out / 'bom.md'}")
    if hardware.back.not_checked:
        say("cad", f"not checked: {hardware.back.not_checked}")
    say("cad", f"{verdict}, {figures} without a limit; open {out / 'index.html'}")
    return 1 if failed else 0


@app.command
def picture(
    layout: LayoutFile,
    device_folder: DeviceFolder,
    /,
    *,
    out: Annotated[Path, Parameter(help="picture to write, .jpg or .png")] = Path("output/product.jpg"),
    force: Force = False,
) -> int:
    """Render a device with its printed parts.

    Shows it from the front, where every mirror shows the lens, and from the side, in 1920 x 1080 pixels.

    Examples:
        mirrorcam cad picture layout.json output/cad --out product.jpg
    """
    from mirrorcam.core.disk.files import write_bytes
    from mirrorcam.core.images.pictures import WRITTEN_ENDINGS, encoded_image
    from mirrorcam.optics.geometry.layout import Layout

    if out.suffix.lower() not in WRITTEN_ENDINGS:
        raise InputError(f"--out {out}: expected a name that ends in {', '.join(WRITTEN_ENDINGS)}")
    device = Layout.load(layout)
    require("render")
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.render_scenes.reference.product_picture import product_picture

    with output_folder(out.parent, "picture", force=force) as output:
        output.refuse_others(glob.escape(out.name))
        say("picture", f"{SPP} samples per pixel ...")
        with output.staged(complete=False) as folder:
            rendered = product_picture(device, device_folder, spp=SPP)
            write_bytes(folder / out.name, encoded_image(rendered, out.suffix.lower(), JPEG_QUALITY))
    say("picture", f"{out} written")
    return 0


@app.command
def adjust(
    calibrated: Annotated[Path, Parameter(name="CALIBRATED", help="layout.json of a calibration of the device")],
    device_folder: DeviceFolder,
    /,
    *,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/turns"),
    force: Force = False,
) -> int:
    """Print how to turn the screws of every mirror.

    For devices with --mounting screws: prints the turns of three screws that bring each mirror to its designed
    position, clockwise as seen from behind the device. Calibrate again afterwards. Writes turns.json and turns.png.
    Exit code 1: a mirror is beyond the travel of its screws.

    Examples:
        mirrorcam cad adjust calibrated/layout.json output/cad
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.geometry.layout import Layout

    require("cad")
    from mirrorcam.device.adjustment import FILES, adjust, read_device, write_adjustment

    with output_folder(out, "adjust", force=force) as output:
        output.refuse_others(*FILES)
        designed, hardware = read_device(device_folder)
        adjustment = adjust(Layout.load(calibrated), designed, hardware)
        with output.staged(result="turns.json") as folder:
            write_adjustment(adjustment, folder)
    head = ["mirror", "tilt deg", "shift mm", "turns of a", "of b", "of c", f"{SIGMA} turns"]
    print_table(head, [_row(mirror) for mirror in adjustment.mirrors])
    unreachable = [mirror.name for mirror in adjustment.mirrors if not mirror.reached]
    if unreachable:
        mirrors = count_text(len(unreachable), "mirror")
        say("adjust", f"{mirrors} beyond the travel of the screws: {', '.join(unreachable)}")
    say("adjust", f"{out / 'turns.png'} shows which screw is which; calibrate again after any turn")
    return 1 if unreachable else 0


def _row(mirror: MirrorTurns) -> list[str]:
    sigma = float(np.max(mirror.sigma_turns))
    return [
        mirror.name,
        f"{mirror.tilt_deg:.3f}",
        f"{mirror.shift_mm:+.3f}",
        *(f"{turn:+.2f}" for turn in mirror.turns),
        "-" if np.isnan(sigma) else f"{sigma:.3f}",
    ]
