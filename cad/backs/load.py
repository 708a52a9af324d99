"""What a back carries: mass and centre of all that stands on it, from the plans, before anything is made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray


@dataclass(frozen=True)
class Load:
    """A mass in g about a point (3,) in rig, mm."""

    mass_g: float
    at: FloatArray


def carried(mount: MountPlan, clip: ClipPlan, hardware: Hardware) -> Load:
    """All but the back: the holder as if it were solid, its mirrors, the mount, the clip and the camera.

    Pieces of a part count in full where they overlap: an estimate from above, by which backs are laid out. Checks weigh
    the parts as made.
    """
    body = body_box(hardware.camera)
    masses = [
        (mount.load_g, mount.load_at),
        _weighed(mount.pieces, hardware),
        _weighed(clip.pieces, hardware),
        (hardware.camera.mass_g, (body.low + body.high) / 2.0),
    ]
    mass = sum(grams for grams, _ in masses)
    return Load(mass, np.asarray(sum(grams * at for grams, at in masses) / mass))


def _weighed(pieces: tuple[Frustum, ...], hardware: Hardware) -> tuple[float, FloatArray]:
    """Mass in g, and the middle (3,), of pieces of plastic."""
    volumes = np.array([abs(volume_mm3(piece)) for piece in pieces])
    middles = np.array([np.vstack([piece.base, piece.top]).mean(axis=0) for piece in pieces])
    return float(volumes.sum()) * hardware.printer.plastic_g_per_cm3 / 1000.0, np.asarray(
        volumes @ middles / volumes.sum()
    )
