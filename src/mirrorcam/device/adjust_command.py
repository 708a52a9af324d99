"""`mirrorcam adjust`: turns of the screws that bring mirrors to where the design has them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from pydantic import Field

from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import SIGMA, count_text
from mirrorcam.core.values import Value


class AdjustOptions(Value):
    """Print how to turn the three screws of every mirror so that it comes to where the design has it.

    For devices with `--mirrors screws`. Turns are clockwise as seen from behind the device. Calibrate again afterwards.
    """

    calibrated: tyro.conf.Positional[Path] = Field(description="layout.json of a calibration of the device")
    device: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Field(
        description="folder of the device, as `mirrorcam cad` wrote it"
    )
    out: Path = Field(default=Path("output/turns"), description="folder for turns.json and turns.png")
    force: bool = FORCE


def run(options: AdjustOptions) -> int:
    """Find the turns, write and draw them, and print a row for every mirror; 1 where one is out of reach."""
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.geometry.layout import Layout

    require("cad")
    from mirrorcam.device.adjustment import FILES, adjust, read_device, write_adjustment

    with output_folder(options.out, "adjust", force=options.force) as output:
        output.refuse_others(*FILES)
        designed, hardware = read_device(options.device)
        found = adjust(Layout.load(options.calibrated), designed, hardware)
        with output.staged(result="turns.json") as folder:
            write_adjustment(found, folder)
    head = ["mirror", "tilt deg", "shift mm", "turns of a", "of b", "of c", f"{SIGMA} turns"]
    print_table(head, [_row(each) for each in found.mirrors])
    beyond = [each.name for each in found.mirrors if not each.reached]
    if beyond:
        say("adjust", f"{count_text(len(beyond), 'mirror')} beyond the travel of the screws: {', '.join(beyond)}")
    say("adjust", f"{options.out / 'turns.png'} shows which screw is which; calibrate again after any turn")
    return 1 if beyond else 0


def _row(each: object) -> list[str]:
    from mirrorcam.device.adjustment import MirrorTurns

    assert isinstance(each, MirrorTurns)
    sigma = float(np.max(each.sigma_turns))
    return [
        each.name,
        f"{each.tilt_deg:.3f}",
        f"{each.shift_mm:+.3f}",
        *(f"{turn:+.2f}" for turn in each.turns),
        "-" if np.isnan(sigma) else f"{sigma:.3f}",
    ]
