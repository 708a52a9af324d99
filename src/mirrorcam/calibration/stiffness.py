"""How far the printed parts bend, beside what a recording shows of all mirrors together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_json
from mirrorcam.core.values import InputError
from mirrorcam.optics.drift.drift import Drift

TILT = "mount.tilt_deg"
SURE = 3.5
"""A common turn counts as more than bending where it is beyond it by this many standard deviations."""


@dataclass(frozen=True)
class MountTilt:
    """How far gravity turns all mirrors together by bending the mount, at worst, and where that is from."""

    deg: float
    source: str


def mount_tilt(checks: Path | None) -> MountTilt:
    """The figure of a device's `checks.json`, or the limit that mounts are designed to.

    Raises InputError where the file does not have it.
    """
    if checks is None:
        return MountTilt(HARDWARE.mount.tilt_deg, "the limit that mounts are designed to")
    found = read_json(checks, LARGEST_LAYOUT_BYTES)
    entry = found.get(TILT) if isinstance(found, dict) else None
    value = entry.get("value") if isinstance(entry, dict) else None
    if not isinstance(value, int | float) or not 0.0 <= value <= 180.0:
        raise InputError(f"{checks}: no angle {TILT} in it, expected checks.json of mirrorcam cad")
    return MountTilt(float(value), str(checks))


def bending_line(drift: Drift, tilt: MountTilt) -> str:
    """Whether the common turn of all mirrors is what bending of the mount allows."""
    bound = f"gravity bends the mount by {tilt.deg:.2g}° at most ({tilt.source}), which turns all mirrors alike"
    turn, sigma = drift.common_turn_deg, drift.common_turn_sigma_deg
    beyond = np.abs(turn) - SURE * sigma > tilt.deg
    if beyond.any():
        axis = int(np.argmax(np.abs(turn) / sigma))
        return (
            f"all mirrors together have turned by {abs(turn[axis]):.2g}° ± {sigma[axis]:.2g}° about {'xyz'[axis]} of "
            f"the rig: more than bending, has the camera slipped? {bound}"
        )
    return f"{bound}; a mirror that turned against the others did not do so by bending"
