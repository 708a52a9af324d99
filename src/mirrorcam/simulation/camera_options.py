"""Options that say which lens, sensor and errors of assembly the rendered camera has."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.core.disk.files import read_model
from mirrorcam.core.values import InputError, InvalidValue
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.render_scenes.settings import SENSORS, SensorModel

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
    presets = {str(name): model for name, model in SENSORS.items()}
    if text in presets:
        return presets[text]
    if not text.endswith(".toml"):
        raise InputError(f"--sensor {text!r}: expected {', '.join(presets)} or a .toml file")
    return read_model(SensorModel, Path(text))
