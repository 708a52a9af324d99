"""The licence of a device, and its complete source: the layout and the hardware from which all its files are made."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import tomli_w

from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.disk.files import write_bytes, write_text
from mirrorcam.optics.geometry.layout import Layout

NOTICE = """\
Copyright the contributors of MirrorCam and of this layout.

This source describes Open Hardware and is licensed under the CERN-OHL-W v2.

You may redistribute and modify this source and make products using it under the terms of the CERN-OHL-W v2
(https://cern.ch/cern-ohl).

This source is distributed WITHOUT ANY EXPRESS OR IMPLIED WARRANTY, INCLUDING OF MERCHANTABILITY, SATISFACTORY QUALITY
AND FITNESS FOR A PARTICULAR PURPOSE. Please see the CERN-OHL-W v2 for applicable conditions.

Source: all files of this folder are made from source/layout.json (layout {identity}) and the other
files in source by the program MirrorCam {version}, which is under Apache-2.0:

    mirrorcam cad source/layout.json --hardware source/hardware.toml{adapter} --out FOLDER

If you convey devices made from this source, changed or not, give the recipients this folder with your changes, or state
where it is available. Equipment to which such a device is only attached, such as a robot or a microscope, is not
affected.
"""


def write_source(folder: Path, layout: Layout, hardware: Hardware) -> None:
    """Write `NOTICE.txt`, and in `source` the files that reproduce all other files.

    These are `layout.json`, `hardware.toml` and the file of a back of your own.
    """
    own = hardware.back.source
    adapter = f" --adapter source/{own.name}" if own else ""
    notice = NOTICE.format(identity=layout.identity, version=version("mirrorcam"), adapter=adapter)
    write_text(folder / "NOTICE.txt", notice)
    if own:
        write_bytes(folder / "source" / own.name, own.read_bytes())
    layout.save(folder / "source" / "layout.json")
    write_text(folder / "source" / "hardware.toml", hardware_toml(hardware))


def hardware_toml(hardware: Hardware) -> str:
    """All dimensions as TOML text, to be read by `read_model(Hardware, path)`."""
    return tomli_w.dumps(hardware.model_dump(mode="json", exclude_none=True))
