"""Requests for designs as files: `design.toml`, or the layout that one led to."""

from __future__ import annotations

from pathlib import Path

from pydantic import ConfigDict

from mirrorcam.optics.base.files import model_of, read_bytes
from mirrorcam.optics.base.values import InputError, Value
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

DESIGN_FILE = "design.toml"


class _Anything(Value):
    """A file of which only the keys matter."""

    model_config = ConfigDict(extra="allow")

    @property
    def keys(self) -> set[str]:
        """Its keys."""
        return set(self.model_extra or {})


def read_request(path: Path) -> DesignSpec:
    """The request in a TOML or JSON file, or of the layout in it; raises InputError in one line."""
    return request_of(path, read_bytes(path))


def request_of(path: Path, raw: bytes) -> DesignSpec:
    """The request in the content of a file, or of the layout in it; the file itself is not read."""
    if path.suffix.lower() not in (".toml", ".json"):
        raise InputError(f"{path}: expected a design.toml or a layout.json")
    if "mirrors" not in model_of(_Anything, path, raw).keys:
        return model_of(DesignSpec, path, raw)
    layout = model_of(Layout, path, raw)
    if layout.spec is None:
        raise InputError(f"{path}: a layout without its request, expected one that `mirrorcam design` wrote")
    return layout.spec


def request_toml(spec: DesignSpec) -> str:
    """The content of `design.toml`."""
    import tomli_w

    return tomli_w.dumps(spec.model_dump(mode="json"))
