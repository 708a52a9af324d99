"""The pictures of a design's report, in themselves."""

from __future__ import annotations

import base64
import tempfile
from pathlib import Path

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.designs.design_figure import before_after
from mirrorcam.designs.design_report import ReportPicture
from mirrorcam.designs.focus_figure import focus_figure
from mirrorcam.designs.tolerance_figure import tolerance_figure
from mirrorcam.optics.design.assess.monte_carlo import Study
from mirrorcam.optics.geometry.layout import Layout


def design_pictures(layout: Layout, parabola: Layout | None, study: Study | None = None) -> list[ReportPicture]:
    """Sensor, mirrors and coverage; the focus of a camera that is no pinhole; with a study, devices as built.

    Raises ValueError for a layout without a spec.
    """
    if layout.spec is None:
        raise ValueError("a layout without a spec, expected one that was designed")
    depths_mm = sorted(layout.spec.depths_mm)
    found = []
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "picture.png"

        def add(title: str, alt: str) -> None:
            found.append(ReportPicture(title, alt, base64.b64encode(read_bytes(path)).decode()))

        before_after(parabola, layout, path)
        add("Sensor, mirrors and coverage", "Sub-images, mirrors, virtual cameras and overlap beside the parabola's")
        if layout.camera.aperture_mm > 0.0:
            focus_figure(layout, depths_mm, path)
            add("Focus", "Circles of confusion over depth, as focused and with the best focus")
        if study is not None:
            tolerance_figure(study, path)
            add("Devices as built", "Figures of devices built with tolerances, against the accuracy of building")
    return found
