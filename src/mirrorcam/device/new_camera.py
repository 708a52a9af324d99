"""A user's own camera: an interview about its dimensions, a drawing of them, and its profile as a file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError

from mirrorcam.core.disk.files import write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import InvalidValue, Value
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody, Lips, Threads
from mirrorcam.optics.geometry.camera_library import CameraProfile

UNKNOWN = "?"
"""Answer for a dimension that cannot be measured: the offered value is kept, and listed as guessed."""

Ask = Callable[[str], str]
Say = Callable[[str], None]


MOUNTING_QUESTIONS = {
    "lips": {"lip_mm": "how far pads may extend over the front from its long edges, mm"},
    "threads": {"thread_depth_mm": "depth of the threads in its side, mm"},
    "board": {
        "hole_mm": "diameter of the holes, mm",
        "post_mm": "height of the parts on the board's back, mm",
        "screw_mm": "thread of the screws, mm",
    },
}
"""Questions about the dimensions by which the clip holds a camera, by `held_by.kind` and field."""


@dataclass(frozen=True)
class Answer:
    """An answer, and whether it is a guess."""

    value: Any
    guessed: bool = False


@dataclass(frozen=True)
class Interview:
    """A dialogue: `ask` returns the answer to a question, or raises EOFError at the end of input; `say` prints a line.

    `earlier` has earlier answers by question, which are offered if the questions are repeated.
    """

    ask: Ask
    say: Say
    earlier: dict[str, str] = field(default_factory=dict)

    def answer(self, question: str, offered: Any, read: Callable[[str], Any]) -> Answer:
        """Ask until the answer is valid; an empty one takes the offered value, `UNKNOWN` takes it as a guess.

        Raises InputError if the input ends.
        """
        default = self.earlier.get(question, f"{offered:g}" if isinstance(offered, float) else str(offered))
        while True:
            try:
                text = self.ask(f"{question} [{default}]: ").strip()
            except EOFError:
                raise InputError(f"camera new: no answer to {question!r}, expected a line for each question") from None
            try:
                value = read(default if text in ("", UNKNOWN) else text)
            except ValueError as error:
                self.say(f"{text[:40]}: {error}")
            else:
                self.earlier[question] = default if text in ("", UNKNOWN) else text
                return Answer(value, text == UNKNOWN)


def ask_profile(like: CameraProfile, interview: Interview) -> CameraProfile:
    """Ask for all figures of a camera; those of a similar one are offered.

    Parameters
    ----------
    like : CameraProfile
        A similar camera, whose figures are offered and kept for empty answers.
    interview : Interview
        The dialogue with the user.

    Returns
    -------
    CameraProfile
        The camera; it has no sources, as all its figures were measured.

    Raises
    ------
    InvalidValue
        If answers contradict each other.
    """
    # Imported here, as it loads the drawing libraries.
    from mirrorcam.cad.guide.camera_measures import MEASUREMENTS

    body: dict[str, Any] = {name: getattr(like.body, name) for name in CameraBody.model_fields}
    guessed: set[str] = set()
    name = interview.answer("name of the camera", like.name, _reader(CameraBody, "name")).value
    for measurement in MEASUREMENTS:
        unit = "" if measurement.description.endswith(", g") else ", mm"
        question = f"{measurement.letter}: {measurement.description}{unit}"
        guesses = like.body.guessed
        answer = interview.answer(question, body[measurement.field], _reader(CameraBody, measurement.field))
        body[measurement.field] = answer.value
        if answer.guessed or (answer.value == getattr(like.body, measurement.field) and measurement.field in guesses):
            guessed.add(measurement.field)
    mounting_guesses = {name for name in like.body.guessed if name.partition(".")[0] == "held_by"}
    body |= {
        "name": name,
        "field_of_view_deg": None,
        "guessed": tuple(sorted(guessed | mounting_guesses)),
        "held_by": _ask_mounting(like.body.held_by, interview),
        "foot_mm": None if body["hinge_mm"] == 0.0 else body["foot_mm"],
    }
    optics = _ask_optics(like, body, interview)
    tables: dict[str, Any] = {"name": name, "body": {key: value for key, value in body.items() if value is not None}}
    guessed_optics: list[str] = []
    if optics is not None:
        tables["optics"], guessed_optics = optics
    return CameraProfile.model_validate(tables | {"guessed": tuple(guessed_optics)})


def _ask_mounting(held_by: Lips | BoardHoles | Threads, interview: Interview) -> dict[str, Any]:
    """Ask how the clip holds the camera: in the same way as the similar one, with its own dimensions."""
    table = held_by.model_dump()
    if isinstance(held_by, BoardHoles):
        halves = []
        for axis, side in enumerate(("width", "height")):
            question = f"distance of the board's holes along the picture's {side}, mm"
            offered_mm = 2.0 * max(abs(hole[axis]) for hole in held_by.holes_mm)
            halves.append(interview.answer(question, offered_mm, _positive).value / 2.0)
        table["holes_mm"] = tuple((x * halves[0], y * halves[1]) for x in (-1.0, 1.0) for y in (-1.0, 1.0))
    for name, question in MOUNTING_QUESTIONS[held_by.kind].items():
        table[name] = interview.answer(question, table[name], _reader(type(held_by), name)).value
    return table


def _ask_optics(
    like: CameraProfile, body: dict[str, Any], interview: Interview
) -> tuple[dict[str, Any], list[str]] | None:
    """Ask for picture size and lens; returns them with the guessed fields, or None for interchangeable lenses."""
    similar = like.optics
    if similar is None:
        return None
    sizes = [
        interview.answer(f"{side} of the picture, px", getattr(similar, f"{side}_px"), _reader(Camera, f"{side}_px"))
        for side in ("width", "height")
    ]
    degrees = round(math.degrees(2.0 * math.atan(similar.width_px / similar.fx_px / 2.0)), 2)
    view = interview.answer(
        "field of view along the picture's width in degrees; or, for a ruler perpendicular to the lens axis, "
        "'MM at MM': the length that fills the picture's width, and its distance from the front of the body",
        f"{degrees:g}",
        lambda text: _half_tangent(text, body["pupil_behind_front_mm"]),
    )
    question = "diameter of the pupil (focal length / f-number), mm"
    pupil = interview.answer(question, similar.aperture_mm, _reader(Camera, "aperture_mm"))
    focus = interview.answer("distance at which its focus is locked, mm", similar.focus_mm, _reader(Camera, "focus_mm"))
    optics = {
        "width_px": int(sizes[0].value),
        "height_px": int(sizes[1].value),
        "fx_px": round(sizes[0].value / 2.0 / view.value, 2),
        "aperture_mm": pupil.value,
        "focus_mm": focus.value,
    }
    guesses = {"fx_px": view.guessed, "aperture_mm": pupil.guessed or "aperture_mm" in like.guessed}
    return optics, [name for name, guess in guesses.items() if guess]


def _half_tangent(text: str, pupil_mm: float) -> float:
    """Tangent of half the field of view, from degrees or from "MM at MM" of a ruler."""
    length, separator, distance = text.partition(" at ")
    if separator:
        tangent = _positive(length) / 2.0 / (_positive(distance) + pupil_mm)
    else:
        tangent = math.tan(math.radians(min(_positive(text), 179.0)) / 2.0)
    if not 0.01 < tangent < 10.0:
        raise ValueError("expected a field of view from 2 to 168 degrees")
    return tangent


def _reader(model: type[Value], name: str) -> Callable[[str], Any]:
    """Return a parser of an answer, validated as a field of a model: its name or a number."""
    info = model.model_fields[name]
    adapter: Any = TypeAdapter(Annotated[(info.annotation, *info.metadata)])  # type: ignore[arg-type]

    def read(text: str) -> Any:
        try:
            return adapter.validate_python(text if name == "name" else _number(text))
        except ValidationError as error:
            message = error.errors()[0]["msg"].removeprefix("Value error, ").lower()
            raise ValueError(message.replace("input should be", "expected")) from None

    return read


def _number(text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise ValueError("expected a number") from None


def _positive(text: str) -> float:
    if (number := _number(text)) <= 0.0 or not math.isfinite(number):
        raise ValueError("expected a number above 0")
    return number


def write_new_camera(path: Path, like: CameraProfile, ask: Ask, say: Say) -> CameraProfile:
    """Draw where to measure, ask, and write a profile to `path` and its drawing next to it, as .svg and .pdf.

    Raises InputError before the first question if one of these files exists.
    """
    import tomli_w

    from mirrorcam.cad.guide.camera_measures import draw_camera

    files = [path, path.with_suffix(".svg"), path.with_suffix(".pdf")]
    if path.suffix != ".toml":
        raise InputError(f"{path}: expected a name that ends in .toml")
    for file in files:
        if file.exists():
            raise InputError(f"{file}: already exists, expected the name of a new file")
    path.parent.mkdir(parents=True, exist_ok=True)
    draw_camera(like.body).write(path.with_suffix(""), f"{like.name}: where to measure")
    say(f"{files[1]} shows where to measure, with the figures of {like.name}")
    interview = Interview(ask, say)
    profile: CameraProfile | None = None
    try:
        while profile is None:
            try:
                profile = ask_profile(like, interview)
            except InvalidValue as error:  # answers contradict each other
                say(f"{error.reason}; please answer again, with your earlier answers in brackets")
    except BaseException:
        # Remove the drawing, so that the command can be repeated with this name.
        for file in files[1:]:
            file.unlink(missing_ok=True)
        raise
    table = profile.model_dump(mode="json", exclude_none=True)
    write_text(path, tomli_w.dumps({key: value for key, value in table.items() if value not in ({}, [], "")}))
    draw_camera(profile.body).write(path.with_suffix(""), f"{profile.name}: as measured")
    return profile
