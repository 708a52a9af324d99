"""Make the gallery of devices: `python -m docs.gallery OUT [--only NAME ...] [--workers N]`.

For each device of docs/gallery/gallery.toml, OUT/NAME gets its design, the output of `mirrorcam cad`, a rendered
picture and a ZIP file with all files to build it; OUT/index.html shows the devices, OUT/gallery.json holds their
figures. Unchanged results are kept, and an interrupted run is resumed. With --record, the figures and the picture in
docs/gallery.md are also written.
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from docs.gallery.devices import (
    COMMAND,
    DeviceList,
    GalleryDevice,
    WorkOfDevice,
    card_of,
    is_finished,
    make_device,
    work_of,
)
from docs.gallery.page import NBSP, GalleryCard, gallery_html
from mirrorcam.cad.plan.prices import hours_text
from mirrorcam.cad.write.slicer import slicer_version
from mirrorcam.core.console.progress import say
from mirrorcam.core.disk.files import read_model, write_bytes, write_json, write_text
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.disk.program import NOT_INSTALLED
from mirrorcam.core.errors import InputError
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import SIGMA, TIMES, count_text, figure_text, number_word
from mirrorcam.core.images.pictures import encoded_image, picture_size, read_image
from mirrorcam.core.processes.worker_pool import Died, cores, run_local
from mirrorcam.core.values import Value

DOCS = Path(__file__).resolve().parents[1]
LICENCE = DOCS.parent / "LICENSES" / "CERN-OHL-W-2.0.txt"
LIST, PAGE = Path(__file__).with_name("gallery.toml"), DOCS / "gallery.md"
OVERVIEW = DOCS / "images" / "gallery.jpg"
KERNEL = ("mirrorcam.cad.device_files", "mirrorcam.optics.design.optimise")
BEGIN, END = "<!-- recorded: python -m docs.gallery OUT --record -->", "<!-- end of the record -->"
OVERVIEW_TILE_PX, OVERVIEW_COLUMNS, OVERVIEW_QUALITY = (320, 180), 4, 80


class Gallery(Value):
    """All figures of a run: the content of gallery.json."""

    schema_id: Literal["mirrorcam.gallery/1"] = Field(default="mirrorcam.gallery/1", alias="schema")
    machine: str
    date: str
    commit: str
    slicer: str
    cards: tuple[GalleryCard, ...]
    work: dict[str, WorkOfDevice]


def table_of(gallery: Gallery) -> str:
    """The table of docs/gallery.md, in Markdown."""
    head = (
        *("device", "views", "camera", "carried by", "size, mm", "mass", "price", "printing"),
        *("sensor usable", f"{SIGMA} of depth", "checks", "processor"),
    )
    rows = []
    for card in gallery.cards:
        work = gallery.work.get(card.name)
        at = card.working
        usable = at.pixel_efficiency if at.usable_efficiency is None else at.usable_efficiency
        cells = (
            *(f"`{card.name}`", card.views.replace(" x ", f"{NBSP}{TIMES}{NBSP}"), card.camera, card.mount),
            f"{NBSP}{TIMES}{NBSP}".join(f"{length:.0f}" for length in card.size_mm),
            *(f"{card.mass_g:.0f}{NBSP}g", f"{card.price:.0f}{NBSP}{card.currency}", hours_text(card.print_minutes)),
            *(f"{usable:.0%}", f"{figure_text(at.sigma_mm, 2)}{NBSP}mm at {at.depth_mm:g}{NBSP}mm", str(card.checks)),
            "-" if work is None else f"{work.total('processor_s'):.0f} s",
        )
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join([f"| {' | '.join(head)} |", "|---" * len(head) + "|", *rows]) + "\n"


def record_of(gallery: Gallery) -> str:
    """The record of a run in docs/gallery.md, in Markdown: all pictures, machine and commit, and the table."""
    count = number_word(len(gallery.cards))
    processor_s = sum(work.total("processor_s") for work in gallery.work.values())
    origin = f"Made on {gallery.date} on a machine with {gallery.machine}, of commit {gallery.commit}"
    return (
        f"![The {count} devices, from the front and from the side](images/{OVERVIEW.name})\n\n"
        f"{origin}, with {gallery.slicer}, in {processor_s / 60.0:.0f} min of processor time.\n\n{table_of(gallery)}"
    )


def with_record(page: str, record: str) -> str:
    """A page of documentation with a new record between its two marks; raises InputError for a page without them."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"{PAGE}: expected a record between {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{record}\n{END}{after}"


def overview(pictures: Sequence[Path]) -> NDArray[np.uint8]:
    """All pictures side by side, in rows of `OVERVIEW_COLUMNS`."""
    tiles = [cv2.resize(read_image(path), OVERVIEW_TILE_PX, interpolation=cv2.INTER_AREA) for path in pictures]
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % OVERVIEW_COLUMNS)
    starts = range(0, len(tiles), OVERVIEW_COLUMNS)
    return np.concatenate([np.concatenate(tiles[at : at + OVERVIEW_COLUMNS], axis=1) for at in starts])


def machine_text() -> str:
    """The processor of this machine, and the number of cores available to this process."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return f"{model or platform.processor() or platform.machine()}, {count_text(cores(), 'core')}"


def commit_text() -> str:
    """The commit of this checkout, with a + if files differ from it; "" outside a checkout."""
    run = partial(subprocess.run, cwd=DOCS, capture_output=True, text=True, check=False)
    head = run(["git", "rev-parse", "--short=12", "HEAD"])
    changed = run(["git", "status", "--porcelain", "--untracked-files=no"]).stdout.strip()
    return f"{head.stdout.strip()}{'+' if changed else ''}" if head.returncode == 0 else ""


def make(devices: Sequence[GalleryDevice], out: Path, workers: int) -> Mapping[str, str]:
    """Make devices in up to `workers` processes; returns the reason for each failure, by the name of the device."""
    failed: dict[str, str] = {}
    with closing(run_local(devices, workers, partial(_make_one, out=out), preload=KERNEL)) as answers:
        for number, answer in answers:
            name = devices[number].name
            summary, error = ("", answer.reason) if isinstance(answer, Died) else answer
            say("gallery", f"{name}: {error or summary}")
            if error:
                failed[name] = error
    return failed


def licence_text() -> str:
    """The licence of the devices' files."""
    return LICENCE.read_text(encoding="utf-8")


def _make_one(device: GalleryDevice, out: Path) -> tuple[str, str]:
    """A summary of the work on a device, and the reason why it failed; one of them is empty."""
    try:
        return make_device(device, out, licence_text()), ""
    except InputError as error:
        return "", str(error)


def write_gallery(devices: Sequence[GalleryDevice], out: Path) -> Gallery:
    """Write index.html and gallery.json of the devices that are finished in a folder."""
    cards = tuple(card_of(device, out / device.name) for device in devices)
    gallery = Gallery(
        machine=machine_text(),
        date=datetime.now(UTC).date().isoformat(),
        commit=commit_text(),
        slicer=slicer_version() or NOT_INSTALLED,
        cards=cards,
        work={device.name: work_of(out / device.name) for device in devices},
    )
    picture_px = picture_size(out / cards[0].picture)
    with output_folder(out, COMMAND) as output:
        output.refuse_others("index.html", "gallery.json")
        with output.staged() as folder:
            page = gallery_html(cards, picture_px, command="python -m docs.gallery")
            write_text(folder / "index.html", page)
            write_json(folder / "gallery.json", gallery.model_dump(mode="json", by_alias=True))
    return gallery


def main(arguments: Sequence[str] | None = None) -> int:
    """Make missing devices, then the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="new folder, or the folder of an earlier run")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="make only these; the page keeps the others")
    parser.add_argument("--workers", type=int, default=cores(), help="devices made at once (one for each core)")
    parser.add_argument("--devices", type=Path, default=LIST, help="the list of devices (docs/gallery/gallery.toml)")
    parser.add_argument("--record", action="store_true", help="also write the figures and the picture of docs/")
    options = parser.parse_args(arguments)
    start = time.perf_counter()
    try:
        require("cad", "render")
        devices = read_model(DeviceList, options.devices).devices
        unknown = sorted(set(options.only or ()) - {device.name for device in devices})
        if unknown:
            raise InputError(f"--only {', '.join(unknown)}: expected names of {options.devices}")
        chosen = [device for device in devices if not options.only or device.name in options.only]
        if options.record and chosen != list(devices):
            raise InputError("--record: expected all devices, without --only")
        if slicer_version() is None:
            say("gallery", "no PrusaSlicer: printing times will be missing, and parts are not checked by slicing")
        failed = make(chosen, options.out, max(options.workers, 1))
        if failed:
            return 1
        others = [
            device for device in devices if device not in chosen and is_finished(device, options.out, licence_text())
        ]
        gallery = write_gallery([device for device in devices if device in (*chosen, *others)], options.out)
        if options.record:
            write_text(PAGE, with_record(PAGE.read_text(encoding="utf-8"), record_of(gallery)))
            image = overview([options.out / card.picture for card in gallery.cards])
            write_bytes(OVERVIEW, encoded_image(image, ".jpg", OVERVIEW_QUALITY))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    elapsed_s = time.perf_counter() - start
    processor_s = sum(work.total("processor_s") for work in gallery.work.values())
    count = count_text(len(gallery.cards), "device")
    say("gallery", f"{count} after {elapsed_s:.0f} s; their stages took {processor_s:.0f} s of processor time")
    say("gallery", f"open {options.out / 'index.html'}")
    return 0
