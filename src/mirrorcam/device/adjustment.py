"""Turns of the mirrors' screws that bring a device back to its design, computed from a calibration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mirrorcam.cad.holder.carriers import tilt_and_shift, travel_turns, turns_to
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan, plan_screwed_holder
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.core.disk.files import atomic, read_model, write_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

FILES = ("turns.json", "turns.png")
LETTERS = "abc"
# Step for the derivative of turns with respect to a virtual centre.
STEP_MM = 1e-4


@dataclass(frozen=True)
class MirrorTurns:
    """Deviation of one mirror from its design, and the turns of its screws that correct it.

    `turns` (3,) are clockwise as seen from behind the device, in the order of the drawing; `sigma_turns` (3,) are their
    standard deviations according to the calibration, NaN if unknown. `reached` is False if a screw would leave its
    travel.
    """

    name: str
    tilt_deg: float
    shift_mm: float
    turns: FloatArray
    sigma_turns: FloatArray
    reached: bool


@dataclass(frozen=True)
class Adjustment:
    """The turns of all mirrors, with their outlines (n, 2) and screws (3, 2) in mm as seen from behind.

    The axes are right and up on the holder's back, from the centre of the mount's screws.
    """

    mirrors: tuple[MirrorTurns, ...]
    outlines_mm: tuple[FloatArray, ...]
    screws_mm: FloatArray


def read_device(folder: Path) -> tuple[Layout, Hardware]:
    """Read the layout and hardware of a device's folder; raises InputError for any other folder."""
    source = folder / "source"
    if not (source / "layout.json").is_file():
        raise InputError(f"{folder}: has no source/layout.json, expected a folder that `mirrorcam cad` wrote")
    table = source / "hardware.toml"
    return Layout.load(source / "layout.json"), read_model(Hardware, table) if table.is_file() else HARDWARE


def adjust(measured: Layout, designed: Layout, hardware: Hardware) -> Adjustment:
    """Compute the turns that bring mirrors from their calibrated to their designed planes.

    Parameters
    ----------
    measured : Layout
        The calibrated layout.
    designed : Layout
        The design of the device.
    hardware : Hardware
        The hardware of the device, with `holder.mirrors = "screws"`.

    Raises
    ------
    InputError
        If the mirrors have no screws, or the layouts have different mirrors.
    """
    if hardware.holder.mirrors != "screws":
        raise InputError('the mirrors of this device are fixed to their holder, expected holder.mirrors = "screws"')
    if measured.mirror_names != designed.mirror_names:
        raise InputError(
            f"the calibration has {len(measured.mirrors)} mirrors, expected the {len(designed.mirrors)} of the device"
        )
    holder = plan_screwed_holder(designed, hardware)
    return Adjustment(
        mirrors=tuple(_turns_of(index, measured, designed, holder) for index in range(len(designed.mirrors))),
        outlines_mm=tuple(
            _viewed_from_behind(mirror.outline_in_rig_mm, holder, designed) for mirror in designed.mirrors
        ),
        screws_mm=_viewed_from_behind(holder.heads, holder, designed).reshape(-1, 3, 2),
    )


def _turns_of(index: int, measured: Layout, designed: Layout, holder: ScrewedHolderPlan) -> MirrorTurns:
    centre = measured.mirrors[index].virtual_centre_in_rig_mm
    target, carrier = designed.mirrors[index].virtual_centre_in_rig_mm, holder.carriers[index]
    turns = turns_to(centre, target, carrier)
    tilt, shift = tilt_and_shift(centre, target)
    d_centre = np.column_stack(
        [(turns_to(centre + step, target, carrier) - turns) / STEP_MM for step in STEP_MM * np.eye(3)]
    )
    covariance = _covariance(index, measured)
    return MirrorTurns(
        name=designed.mirror_names[index],
        tilt_deg=tilt,
        shift_mm=shift,
        turns=turns,
        sigma_turns=np.sqrt(np.diag(d_centre @ covariance @ d_centre.T)),
        reached=bool((np.abs(turns) <= travel_turns(holder.adjuster)).all()),
    )


def _covariance(index: int, layout: Layout) -> FloatArray:
    """Covariance (3, 3) of a mirror's virtual centre, mm^2; NaN where the layout has none."""
    uncertainty = layout.uncertainty
    names = [f"mirror {index} {axis}_mm" for axis in "xyz"]
    if uncertainty is None or not set(names) <= set(uncertainty.parameters):
        return np.full((3, 3), np.nan)
    indices = [uncertainty.parameters.index(name) for name in names]
    return np.asarray(uncertainty.covariance[np.ix_(indices, indices)])


def _viewed_from_behind(points: FloatArray, holder: ScrewedHolderPlan, layout: Layout) -> FloatArray:
    """Project points (n, 3) in the rig frame along the holder's z to (n, 2), right and up from behind the device."""
    frame = holder.rig_from_mount
    outward, up = frame[:3, 2], -layout.view_from_rig[1]
    up = up - (up @ outward) * outward
    if np.linalg.norm(up) < 1e-6:
        up = frame[:3, 1]
    up = up / np.linalg.norm(up)
    return np.asarray((points - frame[:3, 3]) @ np.column_stack([np.cross(up, outward), up]))


def write_adjustment(adjustment: Adjustment, folder: Path) -> None:
    """Write turns.json and turns.png into a folder."""
    rows = [
        {
            "mirror": mirror.name,
            "tilt_deg": round(mirror.tilt_deg, 4),
            "shift_mm": round(mirror.shift_mm, 4),
            "turns": [round(float(turn), 3) for turn in mirror.turns],
            "sigma_turns": [None if np.isnan(sigma) else round(float(sigma), 4) for sigma in mirror.sigma_turns],
            "screws_mm": [[round(float(coordinate), 2) for coordinate in screw] for screw in screws],
            "reached": mirror.reached,
        }
        for mirror, screws in zip(adjustment.mirrors, adjustment.screws_mm, strict=True)
    ]
    write_json(folder / "turns.json", rows)
    turns_figure(adjustment, folder / "turns.png")


def turns_figure(adjustment: Adjustment, path: Path) -> None:
    """Write a PNG of the mirrors from behind, with the turns of their screws."""
    corners = np.vstack(adjustment.outlines_mm)
    width, height = np.ptp(corners, axis=0)
    figure = Figure(figsize=(10.0, 10.0 * height / width + 1.2), layout="constrained")
    axes = figure.add_subplot()
    for mirror, outline, screws in zip(adjustment.mirrors, adjustment.outlines_mm, adjustment.screws_mm, strict=True):
        axes.fill(*outline.T, facecolor="#eef2f6", edgecolor="#7a8896", linewidth=1.0)
        x, y = outline.mean(axis=0)
        axes.text(x, y, mirror.name, ha="center", va="center", color="#9aa6b2", fontsize=13)
        for letter, turn, position in zip(LETTERS, mirror.turns, screws, strict=True):
            axes.plot(*position, marker="o", color="#c8412c" if abs(turn) >= 0.005 else "#5f6b76", markersize=5)
            text = f"{letter} {turn:+.2f}"
            axes.annotate(text, position, (0.0, 5.0), textcoords="offset points", ha="center", fontsize=9)
    axes.set_aspect("equal")
    axes.set_title("From behind the device: turns of the screws, + clockwise (in), - anticlockwise (out)", fontsize=11)
    axes.set_xlabel("mm")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", dpi=130, metadata={"Software": None})
