"""Options that commands share, and values of options that are written as short texts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import tyro
from pydantic import Field

from mirrorcam.optics.base.values import InputError, InvalidValue
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import SENSORS, SensorModel

FORCE_TEXT = "also replace files that this command did not write, or that were changed since"
FORCE = Field(default=False, description=FORCE_TEXT)
AUTO: Final = "auto"
FILE = tyro.conf.arg(metavar="FILE", help_behavior_hint="")
FormatOption = Annotated[
    Literal["auto", "kalibr", "opencv", "ros", "colmap", "mrcal", "anipose", "mirrorcam"],
    Field(description="format of a calibration; auto: as its content says"),
]
UnitOption = Annotated[
    Literal["auto", "mm", "cm", "m", "none"],
    Field(description="unit of its poses; none: they have no scale; auto: as the format has it"),
]
PicturesOption = Annotated[
    Literal["auto", "flipped", "left-right", "top-bottom", "as-is"],
    Field(description="how its pictures came from frames; auto: flipped so that views are upright"),
]
ViewsOption = Annotated[
    Path | None, FILE, Field(description="TOML file that says which camera is which mirror, where names do not")
]
LimitsOption = Annotated[Path | None, FILE, Field(description="TOML file of limits: FIGURE = NUMBER")]
AdapterKind = Literal["none", "tripod", "arca", "iso9409", "gen3", "gen2", "profile20", "vesa", "monitor"]
ADAPTER_TEXT = "what carries the device: a desk, a tripod, an arm and others (docs/cad.md)"
SensorOption = Annotated[
    str,
    tyro.conf.arg(metavar="NAME|PATH"),
    Field(description="lens and sensor model: ideal, c920, poor, webcam, or a .toml file"),
]
TolerancesOption = Annotated[
    str,
    tyro.conf.arg(metavar="NAME=VALUE,...", help_behavior_hint="(a hand-assembled camera)"),
    Field(
        description=(
            "tolerances of the rendered camera as in mirrorcam design --help, like tilt_deg=0.3,offset_mm=0.3; or none"
        )
    ),
]

MIRRORS_TEXT = "how mirrors sit: glued to the holder, or each on a carrier that three sprung screws hold and tilt"


def tolerances_from_text(text: str) -> Tolerances:
    """Parse tolerances from a text like tilt_deg=0.3,offset_mm=0.3, the others by default; "none" is a perfect copy."""
    if text == "none":
        return Tolerances.none()
    parts = [part.partition("=") for part in text.split(",") if part]
    names = [name for name in Tolerances.model_fields if not name.startswith("distortion")]
    for name, _, _ in parts:
        if name not in names:
            raise InputError(f"--as-built {name}: no such tolerance, expected {', '.join(names)}")
    try:
        return Tolerances().replaced(**{name: value for name, _, value in parts})
    except InvalidValue as error:
        name = str(error.first["loc"][0]) if error.first else ""
        value = next((value for each, _, value in parts if each == name), "")
        raise InputError(f"--as-built {name}={value}: {error.reason}") from None


def sensor_from_text(text: str) -> SensorModel:
    """Read a sensor model: a preset by its name, or a TOML file."""
    from mirrorcam.optics.base.files import read_model

    presets = {str(name): model for name, model in SENSORS.items()}
    if text in presets:
        return presets[text]
    if not text.endswith(".toml"):
        raise InputError(f"--sensor {text!r}: expected {', '.join(presets)} or a .toml file")
    return read_model(SensorModel, Path(text))
