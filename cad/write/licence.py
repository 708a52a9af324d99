"""The licence of a device, and its complete source: the layout and the hardware that all of its files are made from."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import tomli_w

from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.disk.files import write_text
from mirrorcam.optics.geometry.layout import Layout

NOTICE = """\
Copyright the contributors of MirrorCam and of this layout.

This source describes Open Hardware and is licensed under the CERN-OHL-W v2.

You may redistribute and modify this source and make products using it under the terms of the CERN-OHL-W v2
(https://cern.ch/cern-ohl).

This source is distributed WITHOUT ANY EXPRESS OR IMPLIED WARRANTY, INCLUDING OF MERCHANTABILITY, SATISFACTORY QUALITY
AND FITNESS FOR A PARTICULAR PURPOSE. Please see the CERN-OHL-W v2 for applicable conditions.

Source: all files of this folder are made from source/layout.json (layout {identity}) and source/hardware.toml by the
program MirrorCam {version}, which is under Apache-2.0:

    mirrorcam cad source/layout.json --hardware source/hardware.toml --out FOLDER

Who conveys devices made from this source, changed or not, gives their recipients this folder as changed, or tells them
where it is. What such a device is only attached to, such as a robot or a microscope, is not affected.
"""


def write_source(folder: Path, layout: Layout, hardware: Hardware) -> None:
    """Write `NOTICE.txt`, `source/layout.json` and `source/hardware.toml`: they make every file of the device again."""
    write_text(folder / "NOTICE.txt", NOTICE.format(identity=layout.identity, version=version("mirrorcam")))
    layout.save(folder / "source" / "layout.json")
    write_text(folder / "source" / "hardware.toml", hardware_toml(hardware))


def hardware_toml(hardware: Hardware) -> str:
    """All dimensions as the text of a TOML file, which `read_model(Hardware, path)` reads."""
    return tomli_w.dumps(hardware.model_dump(mode="json", exclude_none=True))
