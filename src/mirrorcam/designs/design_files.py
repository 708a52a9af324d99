"""A design as files: its request, `design.toml`, the resulting layout and the faceted parabola."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, model_from, read_bytes, tables_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.calls import Calls, in_turn
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import with_tuples
from mirrorcam.optics.design import optimise
from mirrorcam.optics.design.optimise import assessed_parabola
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances

DESIGN_FILE = "design.toml"


def _completed(tolerances: object) -> object:
    """Fill in missing tolerances with those of a hand-made device."""
    if not isinstance(tolerances, dict):
        return tolerances
    return Tolerances.hobby().model_dump() | with_tuples(tolerances)


class DesignRequest(DesignSpec):
    """The content of `design.toml`: a specification and, for `mirrorcam design --tolerance`, tolerances of devices.

    Tolerances that the file leaves out are taken from `Tolerances.hobby`.
    """

    tolerances: Annotated[Tolerances, BeforeValidator(_completed)] = Field(default_factory=Tolerances.hobby)

    @property
    def spec(self) -> DesignSpec:
        """The specification alone."""
        return DesignSpec(**{name: getattr(self, name) for name in DesignSpec.model_fields})


def read_request(path: Path) -> DesignRequest:
    """Read a request from a TOML or JSON file, or from a layout; its camera may be the name of a file.

    Raises a one-line InputError.
    """
    raw = read_bytes(path, LARGEST_LAYOUT_BYTES)
    _require_suffix(path)
    tables = tables_of(path, raw)
    if isinstance(tables, dict) and "mirrors" not in tables:
        tables = with_camera(path, tables)
    return _request_from(path, tables)


def request_of(path: Path, raw: bytes) -> DesignRequest:
    """Parse a request from the content of a file, or of a layout; no file is read."""
    _require_suffix(path)
    return _request_from(path, tables_of(path, raw))


def with_camera(path: Path, tables: dict[str, Any]) -> dict[str, Any]:
    """The fields of a request in a file, with a camera stated by name read from the library or a file."""
    if not isinstance(tables.get("camera"), str):
        return tables
    try:
        camera = read_camera(tables["camera"])
    except InputError as error:
        raise InputError(f"{path}: camera: {error}") from None
    return tables | {"camera": camera.model_dump(mode="json", by_alias=True)}


def _request_from(path: Path, tables: Any) -> DesignRequest:
    if not isinstance(tables, dict) or "mirrors" not in tables:
        return model_from(DesignRequest, path, tables)
    layout = model_from(Layout, path, tables)
    if layout.spec is None:
        raise InputError(f"{path}: a layout without its request, expected one written by `mirrorcam design`")
    return DesignRequest(**{name: getattr(layout.spec, name) for name in DesignSpec.model_fields})


def _require_suffix(path: Path) -> None:
    if path.suffix.lower() not in (".toml", ".json"):
        raise InputError(f"{path}: expected a design.toml or a layout.json")


def request_toml(spec: DesignSpec) -> str:
    """The content of `design.toml`."""
    import tomli_w

    return tomli_w.dumps(spec.model_dump(mode="json"))


@dataclass(frozen=True)
class DesignComparison:
    """An optimised layout and the faceted parabola of its spec, or the reason why it has none; both with figures."""

    optimised: Layout
    parabola: Layout | None
    no_parabola: str = ""


def write_design(
    spec: DesignSpec, folder: Path, calls: Calls = in_turn, progress: Progress = no_progress
) -> DesignComparison:
    """Optimise a layout, and write its files (`write_layout`); `calls` and `progress` as for `design`.

    Raises InfeasibleDesign, before anything is written, if no layout meets the spec.
    """
    return write_layout(optimise.design(spec, calls=calls, progress=progress), folder)


def write_layout(optimised: Layout, folder: Path) -> DesignComparison:
    """Write layout.json, parabola.json (if the layout's spec has one) and before_after.png into a folder.

    Unless the camera is a pinhole, also write focus.png of the optimised layout.
    """
    from mirrorcam.designs.design_figure import before_after, focus_figure

    spec = optimised.designed_spec
    try:
        comparison = DesignComparison(optimised, assessed_parabola(spec))
    except InputError as error:
        comparison = DesignComparison(optimised, None, str(error))
    optimised.save(folder / "layout.json")
    if comparison.parabola is not None:
        comparison.parabola.save(folder / "parabola.json")
    before_after(comparison.parabola, optimised, folder / "before_after.png")
    if spec.camera.aperture_mm > 0.0:
        focus_figure(optimised, spec.depths_mm, folder / "focus.png")
    return comparison
