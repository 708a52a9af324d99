"""A gallery of devices: their list in a TOML file, and for each a folder with all files to build it.

A device's folder holds the results of its stages: `design/`, `cad/`, `picture/device.jpg` and `files/NAME.zip`. A stage
is not repeated if its result exists for the same request, code and files.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from docs.gallery.page import AtDepth, GalleryCard
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.back_table import DeskBack
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.write.slicer import slicer_version
from mirrorcam.core.disk.files import read_record, write_bytes, write_json
from mirrorcam.core.disk.output_folder import OutputFolder, output_folder, results_folder
from mirrorcam.core.disk.program import NOT_INSTALLED
from mirrorcam.core.disk.stages import Stage, perform, refuse_foreign, staleness
from mirrorcam.core.disk.zip_files import files_to_zip, write_zip
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text, figure_text, sentence_case
from mirrorcam.core.images.pictures import encoded_image
from mirrorcam.core.names import Line, Name
from mirrorcam.core.progress import Progress
from mirrorcam.core.values import Value
from mirrorcam.designs.design_files import write_design
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera_library import read_profile
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.run.run_page import read_metrics

COMMAND = "gallery"
SCALE, SPP = 2 / 3, 36
JPEG_QUALITY = 88
README = """\
{title}: a light field camera of {count}

{purpose}.

You need no program of ours, and no Python, to build it:

1. Open index.html in a browser: the device in 3-D, its drawings, parts list and assembly guide.
2. Measure your camera, as step 1 of the guide says: cameras of one model differ.
3. Buy what bom.md lists. Print parts/fit_coupon.3mf first, and see what fits.
4. Print plates/plate_1.3mf, and further plates if there are any (or parts/*.3mf one by one). No part needs support.
5. Have the mirrors cut from mirrors/*.dxf: {mirrors}.
6. Assemble all as the guide says{focus}.
7. Keep layout.json. When the camera is built, MirrorCam calibrates it and decodes its pictures by this file.

All {checks} checks of the program pass, but nobody has built this very device yet, as far as we know. Prices are
estimates. The device and its files are under CERN-OHL-W-2.0: see NOTICE.txt and LICENSE.txt.
"""


class GalleryDevice(Value):
    """A device of the list: its purpose, its request for a design, and its hardware.

    `camera` is a name in the camera library, `pattern` a name like hex7 in place of rows and columns.
    """

    name: str = Field(pattern=r"^[a-z][a-z0-9-]{2,39}$")
    title: Name
    purpose: Line = Field(pattern=r"^for .*[^.]$")
    camera: Name
    pattern: Name | None = None
    design: DesignSpec = DesignSpec()
    hardware: Hardware = HARDWARE

    @model_validator(mode="after")
    def _check(self) -> Self:
        if read_profile(self.camera).optics is None:
            raise ValueError(f"camera {self.camera}: its lens is not specified, expected known optics")
        if self.pattern is not None and Pattern.named(self.pattern) is None:
            raise ValueError(f"pattern {self.pattern}: expected a name like hex7 or ring8")
        return self

    @property
    def spec(self) -> DesignSpec:
        """The request for its layout."""
        pattern = None if self.pattern is None else Pattern.named(self.pattern)
        return self.design.replaced(camera=read_profile(self.camera).camera, pattern=pattern)

    @property
    def made_with(self) -> Hardware:
        """The hardware that its parts are designed for."""
        return self.hardware.replaced(camera=read_profile(self.camera).body)


class DeviceList(Value):
    """The devices of the gallery, in order of appearance."""

    devices: tuple[GalleryDevice, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _check(self) -> Self:
        names = [device.name for device in self.devices]
        if len(set(names)) < len(names):
            raise ValueError("names a device twice")
        return self


class Work(Value):
    """Time that a stage of a device took, s: elapsed, and of all processors (user and system)."""

    seconds: float
    processor_s: float


class WorkOfDevice(Value):
    """Time that the stages of a device took, by their names."""

    stages: dict[str, Work] = Field(default_factory=dict)

    def total(self, field: Literal["seconds", "processor_s"]) -> float:
        """The sum over all stages."""
        return sum(getattr(work, field) for work in self.stages.values())


def device_stages(device: GalleryDevice, root: Path, licence: str) -> tuple[Stage, ...]:
    """The stages of a device in its folder `root`, in order; `licence` is the text of the licence of its files."""
    layout_path, cad, hardware = root / "design" / "layout.json", root / "cad", device.made_with

    def design(folder: Path, progress: Progress) -> None:
        write_design(device.spec, folder)

    def parts(folder: Path, progress: Progress) -> None:
        results, layout = results_folder(root), Layout.load(layout_path)
        checks = build_parts(layout, folder, hardware.for_mirrors_of(layout), results=results, progress=progress)
        failed = [
            f"{name} is {figure_text(check.value)}, limit {check.limit:g}"
            for name, check in checks.items()
            if not check.passed
        ]
        if failed:
            raise InputError(f"{device.name}: {len(failed)} checks failed: {'; '.join(failed)}")

    def picture(folder: Path, progress: Progress) -> None:
        from mirrorcam.render_scenes.reference.product_picture import product_picture

        image = product_picture(Layout.load(layout_path), cad, spp=SPP, scale=SCALE)
        write_bytes(folder / "device.jpg", encoded_image(image, ".jpg", JPEG_QUALITY))

    def files(folder: Path, progress: Progress) -> None:
        layout, checks = Layout.load(layout_path), read_metrics(cad / "checks.json")
        best = layout.metrics.get("best_focus_mm")
        readme = README.format(
            title=device.title,
            count=count_text(len(layout.mirrors), "view"),
            purpose=sentence_case(device.purpose),
            mirrors=mirrors_text(layout, hardware),
            focus=f", and lock the focus of the camera at {best.value:.0f} mm" if best and best.known else "",
            checks=sum(check.limit is not None for check in checks.values()),
        )
        added: dict[str, Path | bytes] = {
            "README.txt": readme.encode(),
            "LICENSE.txt": licence.encode(),
            "layout.json": layout_path,
            "device.jpg": root / "picture" / "device.jpg",
        }
        contents = files_to_zip(cad) | added
        write_zip(folder / f"{device.name}.zip", {f"{device.name}/{name}": file for name, file in contents.items()})

    return (
        Stage(
            "design",
            design,
            "mirrorcam.designs.design_files",
            parameters={"spec": device.spec.model_dump(mode="json")},
        ),
        Stage(
            "cad",
            parts,
            "mirrorcam.cad.build",
            parameters={"hardware": hardware.model_dump(mode="json")},
            reads=(layout_path,),
            programs={"slicer": slicer_version() or NOT_INSTALLED},
        ),
        Stage(
            "picture",
            picture,
            "mirrorcam.render_scenes.reference.product_picture",
            parameters={"scale": SCALE, "spp": SPP},
            reads=(layout_path, cad / "assembly.glb"),
        ),
        Stage(
            "files",
            files,
            "mirrorcam.core.disk.zip_files",
            parameters={"readme": README, "licence": licence, "device": device.model_dump(mode="json")},
            reads=(layout_path, cad, root / "picture" / "device.jpg"),
        ),
    )


def make_device(device: GalleryDevice, out: Path, licence: str) -> str:
    """Do the unfinished stages of a device in the folder `out`/NAME; returns a line that lists them.

    Raises InputError if the device cannot be made or a check fails, and if a file that no stage wrote would be
    replaced.
    """
    root = out / device.name
    done = []
    with output_folder(root, COMMAND) as output:
        refuse_foreign(device_stages(device, root, licence), output)
        for stage in device_stages(device, root, licence):
            if staleness(stage, root):
                start, cpu = time.perf_counter(), processor_s()
                perform(stage, output)
                work = Work(seconds=round(time.perf_counter() - start, 1), processor_s=round(processor_s() - cpu, 1))
                _note_work(output, stage.name, work)
                done.append(f"{stage.name} in {work.seconds:.0f} s")
    return ", ".join(done) or "nothing changed, kept"


def is_finished(device: GalleryDevice, out: Path, licence: str) -> bool:
    """Whether the folder `out`/NAME holds everything that `make_device` would make now."""
    root = out / device.name
    return not any(staleness(stage, root) for stage in device_stages(device, root, licence))


def _note_work(output: OutputFolder, stage: str, work: Work) -> None:
    group = output.grouped("work")
    earlier = work_of(output.root)
    with group.staged(complete=False) as folder:
        write_json(folder / "work.json", WorkOfDevice(stages={**earlier.stages, stage: work}).model_dump(mode="json"))


def work_of(root: Path) -> WorkOfDevice:
    """Time that the stages in a device's folder took; empty if unknown."""
    return read_record(WorkOfDevice, root / "work.json") or WorkOfDevice()


def processor_s() -> float:
    """Processor time of this process and of its ended child processes, s."""
    return sum(os.times()[:4])


def mirrors_text(layout: Layout, hardware: Hardware) -> str:
    """Description of the mirrors of a device."""
    spec = layout.spec or DesignSpec()
    return f"{spec.surface}-surface {hardware.cutting.material}, {spec.thickness_mm:g} mm"


def card_of(device: GalleryDevice, root: Path) -> GalleryCard:
    """The card of a finished device in its folder."""
    from mirrorcam.render_scenes.reference.device_bodies import ASSEMBLY, read_assembly

    layout, checks = Layout.load(root / "design" / "layout.json"), read_metrics(root / "cad" / "checks.json")
    hardware, spec = device.made_with, device.spec
    assembly = read_assembly(root / "cad" / ASSEMBLY)
    points = np.concatenate([body.points for body in assembly.bodies]) @ assembly.stand_from_rig.T
    width_mm, depth_mm, height_mm = np.ptp(points, axis=0).round(1).tolist()
    metrics = {name: metric.value for name, metric in layout.metrics.items()}
    minutes = checks.get("device.print_minutes")
    fixing = {"glue": "glued", "tape": "taped", "screws": "on screws"}[hardware.holder.mirrors]
    return GalleryCard(
        name=device.name,
        title=device.title,
        purpose=device.purpose,
        views=layout.arrangement.text,
        mirror_count=len(layout.mirrors),
        camera=hardware.camera.name,
        mount="a desk, or a tripod" if isinstance(hardware.back, DeskBack) else hardware.back.title,
        mirrors=f"{mirrors_text(layout, hardware)}, {fixing}",
        fasteners={"insert": "heat-set inserts", "nut": "nuts"}[hardware.screw.kind],
        size_mm=(width_mm, height_mm, depth_mm),
        mass_g=checks["device.mass_g"].value,
        price=checks["device.price"].value,
        currency=checks["device.price"].unit,
        print_minutes=minutes.value if minutes else None,
        at_depths=tuple(
            AtDepth(
                depth_mm=depth,
                pixel_efficiency=round(metrics[f"pixel_efficiency_{depth:g}mm"], 4),
                usable_efficiency=round(metrics[f"usable_efficiency_{depth:g}mm"], 4),
                sigma_mm=round(metrics[f"depth_sigma_{depth:g}mm"], 4),
            )
            for depth in sorted(spec.depths_mm)
        ),
        focus_mm=round(metrics["best_focus_mm"], 1),
        checks=sum(check.limit is not None for check in checks.values()),
        zip_bytes=(root / "files" / f"{device.name}.zip").stat().st_size,
    )
