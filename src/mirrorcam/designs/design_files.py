"""A design as files: the optimised layout, the faceted parabola that it starts from, and figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mirrorcam.core.processes.calls import Calls, in_turn
from mirrorcam.core.values import InputError
from mirrorcam.designs.design_figure import before_after
from mirrorcam.designs.focus_figure import focus_figure
from mirrorcam.optics.design import optimise
from mirrorcam.optics.design.optimise import assessed_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout


@dataclass(frozen=True)
class DesignComparison:
    """An optimised layout, and the faceted parabola of its spec, or why the spec has none; both with their figures."""

    optimised: Layout
    parabola: Layout | None
    no_parabola: str = ""


def compare_designs(spec: DesignSpec, calls: Calls = in_turn) -> DesignComparison:
    """Optimise a layout and evaluate the faceted parabola of the same spec; `calls` are those of `design`.

    Raises InfeasibleDesign where no layout meets the spec.
    """
    optimised = optimise.design(spec, calls)
    try:
        return DesignComparison(optimised, assessed_parabola(spec))
    except InputError as error:
        return DesignComparison(optimised, None, str(error))


def write_design(spec: DesignSpec, folder: Path, calls: Calls = in_turn) -> DesignComparison:
    """Write layout.json (optimised), parabola.json (where the spec has one) and before_after.png into a folder.

    Where the camera is no pinhole, also focus.png, of the optimised layout. `calls` are those of `design`.
    Raises InfeasibleDesign, before anything is written, where no layout meets the spec.
    """
    found = compare_designs(spec, calls)
    found.optimised.save(folder / "layout.json")
    if found.parabola is not None:
        found.parabola.save(folder / "parabola.json")
    before_after(found.parabola, found.optimised, folder / "before_after.png")
    if spec.camera.aperture_mm > 0.0:
        focus_figure(found.optimised, spec.depths_mm, folder / "focus.png")
    return found
