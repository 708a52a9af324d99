"""Make the gallery of devices: `python -m docs.gallery OUT [--only NAME ...] [--workers N]`.

For each device of docs/gallery/gallery.toml, OUT/NAME gets its design, all that `mirrorcam cad` writes, a rendered
picture and a ZIP file of all files to make it; OUT/index.html shows them, OUT/gallery.json has their figures. What is
there and has not changed is kept, and a run that was cut off goes on. With --record also the figures and the picture in
docs/gallery.md are written.
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
    """What docs/gallery.md shows of a run, in Markdown: all pictures, where it was made, and the table."""
    count = number_word(len(gallery.cards))
    took = sum(work.total("processor_s") for work in gallery.work.values())
    made = f"Made on {gallery.date} on a machine with {gallery.machine}, of commit {gallery.commit}"
    return (
        f"![The {count} devices, from the front and from the side](images/{OVERVIEW.name})\n\n"
        f"{made}, with {gallery.slicer}, in {took / 60.0:.0f} minutes of one core.\n\n{table_of(gallery)}"
    )


def with_record(page: str, record: str) -> str:
    """A page of documentation with another record between its two marks; raises InputError for one without them."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"{PAGE}: expected a record between {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{record}\n{END}{after}"


def overview(pictures: Sequence[Path]) -> NDArray[np.uint8]:
    """All pictures beside each other, in rows of `OVERVIEW_COLUMNS`."""
    tiles = [cv2.resize(read_image(path), OVERVIEW_TILE_PX, interpolation=cv2.INTER_AREA) for path in pictures]
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % OVERVIEW_COLUMNS)
    starts = range(0, len(tiles), OVERVIEW_COLUMNS)
    return np.concatenate([np.concatenate(tiles[at : at + OVERVIEW_COLUMNS], axis=1) for at in starts])


def machine_text() -> str:
    """The processor of this machine and how many cores of it are used, in a few words."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return f"{named or platform.processor() or platform.machine()}, {count_text(cores(), 'core')}"


def commit_text() -> str:
    """The commit of this checkout, with a + where files differ from it; "" outside of one."""
    run = partial(subprocess.run, cwd=DOCS, capture_output=True, text=True, check=False)
    found = run(["git", "rev-parse", "--short=12", "HEAD"])
    changed = run(["git", "status", "--porcelain", "--untracked-files=no"]).stdout.strip()
    return f"{found.stdout.strip()}{'+' if changed else ''}" if found.returncode == 0 else ""


def make(devices: Sequence[GalleryDevice], out: Path, workers: int) -> Mapping[str, str]:
    """Make devices in as many processes; returns why those were not made that were not, by their names."""
    failed: dict[str, str] = {}
    with closing(run_local(devices, workers, partial(_made, out=out), preload=KERNEL)) as answers:
        for number, answer in answers:
            name = devices[number].name
            told, error = ("", answer.reason) if isinstance(answer, Died) else answer
            say("gallery", f"{name}: {error or told}")
            if error:
                failed[name] = error
    return failed


def licence_text() -> str:
    """The licence of the devices' files."""
    return LICENCE.read_text(encoding="utf-8")


def _made(device: GalleryDevice, out: Path) -> tuple[str, str]:
    """What was done for a device, or why it could not be made: the other devices go on."""
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
    """Make what is missing, then the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder, new or of an earlier run")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="make these alone; the page keeps others")
    parser.add_argument("--workers", type=int, default=cores(), help="devices made at once (one for each core)")
    parser.add_argument("--devices", type=Path, default=LIST, help="the list of devices (docs/gallery/gallery.toml)")
    parser.add_argument("--record", action="store_true", help="also write the figures and the picture of docs/")
    options = parser.parse_args(arguments)
    start = time.perf_counter()
    try:
        require("cad", "render")
        listed = read_model(DeviceList, options.devices).devices
        unknown = sorted(set(options.only or ()) - {device.name for device in listed})
        if unknown:
            raise InputError(f"--only {', '.join(unknown)}: expected names of {options.devices}")
        chosen = [device for device in listed if not options.only or device.name in options.only]
        if options.record and chosen != list(listed):
            raise InputError("--record: expected all devices, without --only")
        if slicer_version() is None:
            say("gallery", "no PrusaSlicer: times of printing will be missing, and parts are not checked by slicing")
        failed = make(chosen, options.out, max(options.workers, 1))
        if failed:
            return 1
        others = [
            device for device in listed if device not in chosen and is_finished(device, options.out, licence_text())
        ]
        gallery = write_gallery([device for device in listed if device in (*chosen, *others)], options.out)
        if options.record:
            write_text(PAGE, with_record(PAGE.read_text(encoding="utf-8"), record_of(gallery)))
            image = overview([options.out / card.picture for card in gallery.cards])
            write_bytes(OVERVIEW, encoded_image(image, ".jpg", OVERVIEW_QUALITY))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    took = time.perf_counter() - start
    processors = sum(work.total("processor_s") for work in gallery.work.values())
    shown_text = count_text(len(gallery.cards), "device")
    say("gallery", f"{shown_text} after {took:.0f} s; their stages took {processors:.0f} s of processors")
    say("gallery", f"open {options.out / 'index.html'}")
    return 0
