"""A calibrated camera without mirrors as a file, `camera.json`, with the covariance of its intrinsics."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_bytes, read_model, tables_of, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric, Value
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import CALIBRATED_SCHEMA
from mirrorcam.optics.geometry.layout import Layout, Uncertainty


class CalibratedCamera(Value):
    """A camera with the covariance of its intrinsics, as calibrated from pictures of a board.

    Attributes
    ----------
    camera : Camera
        The camera.
    metrics : dict of str to Metric
        Figures of merit of the calibration.
    provenance : dict of str to str
        The fitted model.
    uncertainty : Uncertainty
        Covariance of the free intrinsics, by `Camera.intrinsic_names`.
    """

    schema_id: Literal["mirrorcam.camera/1"] = Field(default="mirrorcam.camera/1", alias="schema")
    camera: Camera
    metrics: dict[str, Metric] = Field(default_factory=dict)
    provenance: dict[str, str] = Field(default_factory=dict)
    uncertainty: Uncertainty

    @classmethod
    def of(cls, layout: Layout) -> Self:
        """The camera of a calibrated layout; raises InputError if this has no covariance or has mirrors."""
        if layout.mirrors or layout.uncertainty is None:
            raise InputError(f"a {layout.kind} layout of {len(layout.mirrors)} mirrors, expected a calibrated camera")
        return cls(
            camera=layout.camera, metrics=layout.metrics, provenance=layout.provenance, uncertainty=layout.uncertainty
        )

    @property
    def layout(self) -> Layout:
        """The camera as a layout without mirrors."""
        return Layout.bare(self.camera).replaced(
            metrics=self.metrics, provenance=self.provenance, uncertainty=self.uncertainty
        )

    def save(self, path: AnyPath) -> None:
        """Write `camera.json` atomically."""
        write_text(path_of("path", path), self.model_dump_json(indent=1, by_alias=True, exclude_none=True) + "\n")

    @classmethod
    def load(cls, path: AnyPath) -> Self:
        """Read `camera.json`. Raises InputError, with a one-line message, for invalid content."""
        return read_model(cls, path_of("path", path), LARGEST_LAYOUT_BYTES)


def is_calibrated_camera(path: AnyPath) -> bool:
    """Whether a file holds a calibrated camera, by its schema; raises InputError if it cannot be read."""
    file = path_of("path", path)
    tables = tables_of(file, read_bytes(file, LARGEST_LAYOUT_BYTES))
    return isinstance(tables, dict) and tables.get("schema") == CALIBRATED_SCHEMA
