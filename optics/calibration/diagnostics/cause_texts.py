"""A cause of a misfit in words: what it is, and what to do about it."""

from __future__ import annotations

from collections.abc import Callable
from shlex import quote

from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.left_out import LeftOut
from mirrorcam.optics.calibration.diagnostics.score_test import Cause, CauseKind

_SENTENCES: dict[CauseKind, str] = {
    "picture": "{picture} contradicts the other pictures",
    "mirror moved": "{mirror} moved before {picture} was taken",
    "mirror bent": "{mirror} is not flat",
    "bend": "the mirrors are not flat",
    "lens": "the lens distorts differently from its model",
    "spline": "the lens deviates irregularly from its model",
    "pupil": "the pupil of the lens moves with the angle of view",
    "colour": "the lens shows colours at different sizes, so that grey pictures grow out of focus",
    "shutter": "board or camera moved while the rows of a picture were read",
    "plate": "the mirrors reflect behind a plate of another thickness than in the layout",
    "warp": "the board is warped",
    "bow": "the board is bowed differently in each picture",
    "turn": "the camera turned between the pictures",
    "board": "the corners of the board are not where its drawing has them",
    "board changed": "the board changed its shape before {picture} was taken",
    "size": "the print of the board is stretched or sheared",
    "focus": "focus or zoom changed {when}",
}
_ADVICE: dict[CauseKind, str] = {
    "picture": "Calibrate again with {leave_out}.",
    "mirror moved": "Fasten {mirror}; calibrate from the pictures before {picture} alone, or from those after.",
    "mirror bent": "Calibrate again with {addition}, or mount {mirror} without stress.",
    "bend": "Calibrate again with {addition}, or mount the mirrors without stress.",
    "lens": "Calibrate again with {addition}.",
    "spline": "Calibrate again with {addition}.",
    "pupil": "Calibrate again with {addition}.",
    "colour": "Calibrate again with {addition}.",
    "shutter": "Calibrate again with {addition}, or take the pictures again with board and camera at rest.",
    "plate": "Measure the thickness of the mirrors, correct it in the layout, and calibrate again.",
    "warp": "Calibrate again with {addition}, or mount the board on a flat plate.",
    "bow": "Calibrate again with {addition}, or mount the board on a stiff plate.",
    "turn": "Calibrate again with {addition}, or fasten the camera.",
    "board": "Calibrate again with {addition}, or measure the print.",
    "board changed": "Mount the board on a stiff plate, or calibrate from the pictures before {picture} alone.",
    "size": "Measure the print along both sides: printers may scale them differently.",
    "focus": "Take all pictures again with focus and zoom fixed.",
}


def cause_sentence(cause: Cause, calibration: Calibration) -> str:
    """Name a cause and its share of the misfit: "mirror 1-2 is not flat (61 % of the misfit)"."""
    return f"{_filled(_SENTENCES[cause.kind], cause, calibration)} ({cause.fraction:.0%} of the misfit)"


def cause_advice(cause: Cause, calibration: Calibration) -> str:
    """Advise on a cause, for pictures with what is gained by leaving them out."""
    diagnostics = calibration.diagnostics
    left_out = None if diagnostics is None else diagnostics.left_out
    if cause.kind != "picture" or left_out is None:
        return _filled(_ADVICE[cause.kind], cause, calibration)
    before, after = left_out.rms_px
    return (
        f"Calibrate again with {leave_out_option(left_out, calibration)}: residuals fall from {before:.2g} to "
        f"{after:.2g} px, and the error bounds of the {'mirrors' if calibration.layout.mirrors else 'camera'} to "
        f"{left_out.sigma_ratio:.0%}."
    )


def leave_out_option(left_out: LeftOut, calibration: Calibration) -> str:
    """The option that leaves pictures out: "--leave-out frame_0004.png"."""
    names = (calibration.picture_names[frame] for frame in left_out.frames)
    return " ".join(f"--leave-out {quote(name)}" for name in names)


def _filled(text: str, cause: Cause, calibration: Calibration) -> str:
    model_name = "auto" if calibration.diagnostics is None else calibration.diagnostics.model_name
    parts: dict[str, Callable[[], str]] = {
        "picture": lambda: f"picture {calibration.picture_names[cause.frame or 0]}",
        "when": lambda: (
            "between the pictures with and without mirrors"
            if cause.frame is None
            else f"before picture {calibration.picture_names[cause.frame]} was taken"
        ),
        "mirror": lambda: f"mirror {calibration.layout.mirror_names[cause.mirror or 0]}",
        "addition": lambda: f"--model {model_name}+{cause.addition}",
        "leave_out": lambda: f"--leave-out {quote(calibration.picture_names[cause.frame or 0])}",
    }
    return text.format(**{name: part() for name, part in parts.items() if f"{{{name}}}" in text})
