"""Tolerances of built devices. Imports little, because commands show these options in their help."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field

from mirrorcam.core.bounds import TOLERANCE_DEG, TOLERANCE_MM, Bounds
from mirrorcam.core.values import Value

MAX_TERM = 10.0
_Term = Annotated[float, Field(ge=-MAX_TERM, le=MAX_TERM)]
_Sigma = Annotated[float, Field(ge=0.0, le=MAX_TERM)]
Lens = tuple[_Term, _Term, _Term, _Term, _Term]
LensSigma = tuple[_Sigma, _Sigma, _Sigma, _Sigma, _Sigma]

NO_LENS: Lens = (0.0, 0.0, 0.0, 0.0, 0.0)

# Tolerances of printing and assembly; the others belong to the camera.
WORKMANSHIP = ("tilt_deg", "offset_mm", "sheet_thickness_mm", "camera_offset_mm", "camera_turn_deg")


class Tolerances(Value):
    """Standard deviations of built devices from their design, and of lens distortion, which data sheets omit."""

    # Defaults: a hand-assembled mirror camera with a good webcam, in the frame of that webcam. Its pictures do not
    # depend on its position in the holder, so the tolerances of the camera's pose are zero.
    tilt_deg: float = TOLERANCE_DEG.field(0.3, "tilt of a mirror about each of two axes in its plane")
    offset_mm: float = TOLERANCE_MM.field(0.3, "shift of a mirror along its normal")
    sheet_thickness_mm: float = TOLERANCE_MM.field(0.0, "thickness of the stock sheet that all mirrors are cut from")
    camera_offset_mm: float = TOLERANCE_MM.field(0.0, "shift of the camera's pupil in the holder, along each axis")
    camera_turn_deg: float = TOLERANCE_DEG.field(0.0, "rotation of the camera in the holder, about each axis")
    focal_percent: float = Bounds(0.0, 100.0).field(1.0, "focal length, in percent")
    centre_px: float = Bounds(0.0, 10_000.0).field(8.0, "principal point, along each axis")
    distortion_mean: Lens = Field(
        default=(0.05, -0.1, 0.0, 0.0, 0.0), description="mean of the distortion k1 k2 p1 p2 k3, each from -10 to 10"
    )
    distortion_sigma: LensSigma = Field(
        default=(0.02, 0.03, 5e-4, 5e-4, 0.0),
        description="standard deviation of the distortion k1 k2 p1 p2 k3, each from 0 to 10",
    )

    @classmethod
    def none(cls) -> Self:
        """Zero tolerances: a device exactly as designed."""
        zero = {name: 0.0 for name in cls.model_fields if not name.startswith("distortion")}
        return cls(**zero, distortion_mean=NO_LENS, distortion_sigma=NO_LENS)

    @classmethod
    def hobby(cls) -> Self:
        """A holder from a hobby FDM printer, with mirrors glued by hand and a webcam with a known lens.

        A seat 30 mm across that is 0.15 mm higher at one end is tilted by 0.3 degrees. Glue and layers lift a mirror by
        about one layer, 0.3 mm. Acrylic of 1 mm is sold with +-10 % (2 sigma). Measuring the webcam's case with a ruler
        leaves an uncertainty of half a millimetre in the pupil and half a degree in the camera's orientation.
        """
        made_by_hand = {
            "tilt_deg": 0.3,
            "offset_mm": 0.3,
            "sheet_thickness_mm": 0.05,
            "camera_offset_mm": 0.5,
            "camera_turn_deg": 0.5,
        }
        return cls.none().replaced(**made_by_hand)

    def times(self, factor: float) -> Self:
        """Scale the tolerances of printing and assembly by a factor, but not the camera's."""
        return self.replaced(**{name: factor * getattr(self, name) for name in WORKMANSHIP})

    def only(self, *names: str) -> Self:
        """Keep only these tolerances; all others are zero."""
        return type(self).none().replaced(**{name: getattr(self, name) for name in names})

    @property
    def workmanship(self) -> str:
        """The tolerances of printing and assembly, in words."""
        return (
            f"mirrors tilted {self.tilt_deg:g}° and shifted {self.offset_mm:g} mm, "
            f"sheet {self.sheet_thickness_mm:g} mm, "
            f"camera shifted {self.camera_offset_mm:g} mm and rotated {self.camera_turn_deg:g}°"
        )
