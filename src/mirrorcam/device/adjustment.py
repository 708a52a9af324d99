"""Turns of the mirrors' screws that bring a device to its design, from a calibration."""

from __future__ import annotations

from collections.abc import Sequence
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
# Step for the derivative of turns by a virtual centre.
STEP_MM = 1e-4


@dataclass(frozen=True)
class MirrorTurns:
    """Deviation of one mirror from its design, and the turns of its screws that correct it.

    `turns` (3,) are clockwise as seen from behind the device, in the order of the drawing; `sigma_turns` (3,) is their
    standard deviation by the calibration, NaN if unknown. `reached` is False if a screw would leave its travel.
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
    """Read the layout and hardware of a device's folder; raises InputError for another folder."""
    source = folder / "source"
    if not (source / "layout.json").is_file():
        raise InputError(f"{folder}: no source/layout.json in it, expected a folder that `mirrorcam cad` wrote")
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
        raise InputError('mirrors of this device are glued to their holder, expected holder.mirrors = "screws"')
    if measured.mirror_names != designed.mirror_names:
        raise InputError(
            f"calibration of {len(measured.mirrors)} mirrors, device of {len(designed.mirrors)}, expected the same"
        )
    holder = plan_screwed_holder(designed, hardware)
    return Adjustment(
        mirrors=tuple(_turns_of(index, measured, designed, holder) for index in range(len(designed.mirrors))),
        outlines_mm=tuple(_seen_from_behind(mirror.outline_in_rig_mm, holder, designed) for mirror in designed.mirrors),
        screws_mm=_seen_from_behind(holder.heads, holder, designed).reshape(-1, 3, 2),
    )


def _turns_of(index: int, measured: Layout, designed: Layout, holder: ScrewedHolderPlan) -> MirrorTurns:
    centre = measured.mirrors[index].virtual_centre_in_rig_mm
    wanted, carrier = designed.mirrors[index].virtual_centre_in_rig_mm, holder.carriers[index]
    turns = turns_to(centre, wanted, carrier)
    tilt, shift = tilt_and_shift(centre, wanted)
    by_centre = np.column_stack(
        [(turns_to(centre + step, wanted, carrier) - turns) / STEP_MM for step in STEP_MM * np.eye(3)]
    )
    covariance = _covariance(index, measured)
    return MirrorTurns(
        name=designed.mirror_names[index],
        tilt_deg=tilt,
        shift_mm=shift,
        turns=turns,
        sigma_turns=np.sqrt(np.diag(by_centre @ covariance @ by_centre.T)),
        reached=bool((np.abs(turns) <= travel_turns(holder.adjuster)).all()),
    )


def _covariance(index: int, layout: Layout) -> FloatArray:
    """Covariance (3, 3) of a mirror's virtual centre, mm^2; NaN where the layout has none."""
    known = layout.uncertainty
    names = [f"mirror {index} {axis}_mm" for axis in "xyz"]
    if known is None or not set(names) <= set(known.parameters):
        return np.full((3, 3), np.nan)
    indices = [known.parameters.index(name) for name in names]
    return np.asarray(known.covariance[np.ix_(indices, indices)])


def _seen_from_behind(points: FloatArray, holder: ScrewedHolderPlan, layout: Layout) -> FloatArray:
    """Project points (n, 3) in rig along the holder's z to (n, 2), right and up as seen from behind the device."""
    frame = holder.rig_from_mount
    away, up = frame[:3, 2], -layout.view_from_rig[1]
    up = up - (up @ away) * away
    if np.linalg.norm(up) < 1e-6:
        up = frame[:3, 1]
    up = up / np.linalg.norm(up)
    return np.asarray((points - frame[:3, 3]) @ np.column_stack([np.cross(up, away), up]))


def write_adjustment(found: Adjustment, folder: Path) -> None:
    """Write turns.json and turns.png into a folder."""
    rows = [
        {
            "mirror": each.name,
            "tilt_deg": round(each.tilt_deg, 4),
            "shift_mm": round(each.shift_mm, 4),
            "turns": [round(float(turn), 3) for turn in each.turns],
            "sigma_turns": [None if np.isnan(sigma) else round(float(sigma), 4) for sigma in each.sigma_turns],
            "screws_mm": [[round(float(at), 2) for at in screw] for screw in screws],
            "reached": each.reached,
        }
        for each, screws in zip(found.mirrors, found.screws_mm, strict=True)
    ]
    write_json(folder / "turns.json", rows)
    turns_figure(
        [each.name for each in found.mirrors],
        [each.turns for each in found.mirrors],
        found.outlines_mm,
        found.screws_mm,
        folder / "turns.png",
    )


def turns_figure(
    names: Sequence[str],
    turns: Sequence[FloatArray],
    outlines_mm: Sequence[FloatArray],
    screws_mm: FloatArray,
    path: Path,
) -> None:
    """Draw mirrors from behind, with the turns of their screws.

    Parameters
    ----------
    names : sequence of str
        Names of the mirrors.
    turns : sequence of (3,)
        Clockwise turns of each mirror's screws.
    outlines_mm : sequence of (n, 2)
        Outlines of the mirrors, right and up as seen from behind, mm.
    screws_mm : (m, 3, 2)
        Screws of each mirror, likewise.
    path : Path
        PNG file to write.
    """
    corners = np.vstack(outlines_mm)
    width, height = np.ptp(corners, axis=0)
    figure = Figure(figsize=(10.0, 10.0 * height / width + 1.2), layout="constrained")
    axes = figure.add_subplot()
    for name, own, outline, screws in zip(names, turns, outlines_mm, screws_mm, strict=True):
        axes.fill(*outline.T, facecolor="#eef2f6", edgecolor="#7a8896", linewidth=1.0)
        x, y = outline.mean(axis=0)
        axes.text(x, y, name, ha="center", va="center", color="#9aa6b2", fontsize=13)
        for letter, turn, at in zip(LETTERS, own, screws, strict=True):
            axes.plot(*at, marker="o", color="#c8412c" if abs(turn) >= 0.005 else "#5f6b76", markersize=5)
            text = f"{letter} {turn:+.2f}"
            axes.annotate(text, at, (0.0, 5.0), textcoords="offset points", ha="center", fontsize=9)
    axes.set_aspect("equal")
    axes.set_title("From behind the device: turns of the screws, + clockwise (in), - anticlockwise (out)", fontsize=11)
    axes.set_xlabel("mm")
    with atomic(path) as temporary:
        figure.savefig(temporary, format="png", dpi=130, metadata={"Software": None})
