"""Light fields of a stream on disk: written frame by frame, whole under its own name or a beginning to go on from."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self, TextIO

from pydantic import ConfigDict, Field, model_validator

from mirrorcam.core.disk.files import (
    LARGEST_FILE_BYTES,
    json_of,
    linked,
    read_json,
    read_lines,
    write_json,
    write_text,
)
from mirrorcam.core.disk.fingerprint import differing
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.interruption import deferred
from mirrorcam.core.values import InvalidValue, Value
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.optics.light_field.io.views_file import fields_of_views
from mirrorcam.optics.light_field.light_field import LightField, Views

SCHEMA = "mirrorcam.light_field/1"
JOURNAL = "journal.jsonl"
INDEX = "frames.json"


def about(views: Views, source: dict[str, Any], **settings: Any) -> dict[str, Any]:
    """Attributes of a recording, as JSON: its views and source, and the settings it was decoded with."""
    return {"schema": SCHEMA, "source": source, **settings, "views": fields_of_views(views)}


class NothingDecoded(InputError):
    """A source of which no frame could be decoded."""


class _Frame(Value):
    """A line of the journal: a frame that is kept, with its time, or lost, with the reason."""

    model_config = ConfigDict(extra="ignore")

    number: int = Field(ge=0)
    time_s: float | None = None
    lost: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.time_s is None) == (self.lost is None):
            raise ValueError("expected time_s or lost")
        return self


@dataclass
class Entries:
    """The frames that a recording holds, in order: numbers in the source, times in s; and those lost, with reasons."""

    numbers: list[int] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)
    lost: dict[int, str] = field(default_factory=dict)

    @classmethod
    def of(cls, lines: Iterable[Any], where: Path) -> Entries:
        """The entries of lines as in a journal; raises InputError in one line for any others."""
        entries = cls()
        for line in lines:
            entries.note(line, where)
        numbers = [*entries.numbers, *entries.lost]
        if entries.numbers != sorted(entries.numbers) or len(set(numbers)) != len(numbers):
            raise InputError(f"{where}: numbers of frames do not increase, expected each once and in order")
        return entries

    def note(self, line: Any, where: Path) -> None:
        """Add a line of the journal; raises InputError where it is not valid."""
        try:
            frame = _Frame.model_validate(line, strict=True)
        except InvalidValue as error:
            raise InputError(f"{where}: no list of frames: {error}") from None
        if frame.lost is not None:
            self.lost[frame.number] = frame.lost
        else:
            assert frame.time_s is not None
            self.numbers.append(frame.number)
            self.times_s.append(frame.time_s)

    @property
    def last(self) -> int:
        """The highest number of a frame, kept or lost; -1 before the first."""
        return max((*self.numbers[-1:], *self.lost), default=-1)


class Sink(Protocol):
    """Layout of light fields in a folder. The same calls must leave the same bytes."""

    def open(self, folder: Path, about: dict[str, Any]) -> None:
        """Begin in a folder, or go on in one; what lies there at the index of the next `write` may be half written."""

    def write(self, index: int, number: int, light_field: LightField) -> None:
        """Add the light field at an index that counts up without gaps, frame `number` of the source."""

    def close(self, folder: Path, about: dict[str, Any], entries: Entries) -> None:
        """Write what is known only at the end."""

    def read(self, path: Path) -> tuple[dict[str, Any], Entries]:
        """Read what `close` wrote: the attributes of the recording, and its frames."""


class Recording:
    """Light fields being written to `path`.

    Until `finish`, they lie in `path` + ".partial", beside a journal with a line for every frame that is whole there.
    Opened again with the same `about`, writing goes on after them, and ends in the same bytes as if it had never
    stopped.

    Attributes
    ----------
    entries
        Journal entries of the frames that have been written.
    complete
        Whether `path` was there already, written with the same `about`; there is nothing left to do then.

    Raises
    ------
    InputError
        Where `path` or its beginning is of something else, and where nothing can be written.
    """

    def __init__(self, path: Path, about: dict[str, Any], sink: Sink) -> None:
        self.path, self._sink = path, sink
        self._about = json.loads(json.dumps(about, allow_nan=False))
        self._folder = path.with_name(path.name + ".partial")
        self._journal: TextIO | None = None
        self.entries = Entries()
        self.complete = path.exists()
        for place in (path, self._folder):
            link = place if place.is_symlink() else linked(place)
            if link is not None:
                raise InputError(f"{link}: is a link, expected only files and folders in a recording, or a new name")
        if self.complete:
            attributes, self.entries = sink.read(path)
            if other := differing(attributes, self._about):
                raise InputError(
                    f"{path}: exists and holds something else, expected a new name or the same job again: "
                    f"{' and '.join(other)} differ"
                )
            # There still where a run was cut off between its last two steps.
            (path / JOURNAL).unlink(missing_ok=True)
            return
        journal = self._folder / JOURNAL
        lines = whole_lines(journal)
        if lines and (other := differing(lines[0], self._about)):
            raise InputError(
                f"{self._folder}: is the beginning of another job, expected the same job or no such folder: "
                f"{' and '.join(other)} differ"
            )
        if not lines and self._folder.exists() and not set(self._folder.iterdir()) <= {journal}:
            raise InputError(f"{self._folder}: exists, expected the beginning of {path.name} or nothing")
        self.entries = Entries.of(lines[1:], journal)
        with self._writing():
            self._folder.mkdir(parents=True, exist_ok=True)
            write_text(journal, "".join(json.dumps(line) + "\n" for line in lines or [self._about]))
            self._journal = journal.open("a", encoding="utf-8")
            sink.open(self._folder, self._about)

    def add(self, frame: Frame, light_field: LightField) -> None:
        """Write the light field of a frame; it counts once its line is in the journal."""
        with self._writing():
            self._sink.write(len(self.entries.numbers), frame.number, light_field)
            self._note({"number": frame.number, "time_s": frame.time_s})

    def lose(self, lost: Lost) -> None:
        """Note a frame that cannot be used."""
        with self._writing():
            self._note({"number": lost.number, "lost": lost.reason})

    def finish(self) -> None:
        """Give the recording its own name, or, where it has no frame, remove its beginning and raise NothingDecoded."""
        self.close()
        if not self.entries.numbers:
            shutil.rmtree(self._folder)
            name = self._about["source"].get("file", self.path.name)
            raise NothingDecoded(f"{name}: not one frame could be decoded, expected at least one")
        with self._writing():
            self._sink.close(self._folder, self._about, self.entries)
            self._folder.rename(self.path)
            (self.path / JOURNAL).unlink()

    def close(self) -> None:
        """Let go of the journal; what is written stays to go on from."""
        if self._journal is not None:
            self._journal.close()

    def _note(self, line: dict[str, Any]) -> None:
        assert self._journal is not None
        self._journal.write(json.dumps(line) + "\n")
        self._journal.flush()
        self.entries.note(line, self._folder / JOURNAL)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        kept = "before are whole, and the same command resumes after them"
        try:
            # Zarr leaves what it has begun unfinished where a signal's exception strikes it.
            with deferred():
                yield
        except InputError as error:
            raise InputError(f"{error}; {len(self.entries.numbers)} frames {kept}") from None
        except OSError as error:
            reason = error.strerror or error
            raise InputError(
                f"{self.path}: cannot be written: {reason}; {len(self.entries.numbers)} frames {kept}"
            ) from None


def read_journal(journal: Path) -> tuple[dict[str, Any], Entries]:
    """The attributes and the frames of a recording that was cut off, as far as its journal was written to the end."""
    lines = whole_lines(journal)
    if not lines or lines[0].get("schema") != SCHEMA:
        raise InputError(f"{journal}: not the journal of a recording, expected the schema {SCHEMA!r} in its first line")
    return lines[0], Entries.of(lines[1:], journal)


def whole_lines(journal: Path) -> list[dict[str, Any]]:
    """The journal's lines up to the first that was not written to its end; none where there is no journal.

    Raises InputError for a line that is no JSON object.
    """
    if not journal.exists():
        return []
    whole = []
    for line in read_lines(journal)[:-1]:
        try:
            whole.append(json_of(journal, line))
        except InputError:
            break
        if not isinstance(whole[-1], dict):
            raise InputError(f"{journal}: holds {str(whole[-1])[:40]!r}, expected lines of a journal")
    return whole


class Folders:
    """A sink of one folder per frame, named by its number in the source, and `frames.json`.

    Parameters
    ----------
    write_one
        Function that writes a light field into an empty folder.
    """

    def __init__(self, write_one: Callable[[Path, LightField], None]) -> None:
        self._write_one = write_one

    def open(self, folder: Path, about: dict[str, Any]) -> None:
        self._folder = folder

    def write(self, index: int, number: int, light_field: LightField) -> None:
        """Write the frame's folder, in place of one that an interrupted run has left."""
        whole, beginning = self._folder / f"{number:06d}", self._folder / f"{number:06d}.partial"
        for left in (whole, beginning):
            if left.exists():
                shutil.rmtree(left)
        beginning.mkdir()
        self._write_one(beginning, light_field)
        beginning.rename(whole)

    def close(self, folder: Path, about: dict[str, Any], entries: Entries) -> None:
        """Write `frames.json`: the description of the recording, and its frames."""
        for left in folder.glob("*.partial"):
            shutil.rmtree(left)
        frames = [
            {"number": number, "time_s": time_s, "folder": f"{number:06d}"}
            for number, time_s in zip(entries.numbers, entries.times_s, strict=True)
        ]
        lost = [{"number": number, "lost": reason} for number, reason in sorted(entries.lost.items())]
        write_json(folder / INDEX, {**about, "frames": frames, "lost": lost})

    def read(self, path: Path) -> tuple[dict[str, Any], Entries]:
        """Read `frames.json`."""
        if not path.is_dir() or not (path / INDEX).exists():
            raise InputError(f"{path}: exists and is no folder of light fields, expected a new name")
        attributes, entries = read_json(path / INDEX, LARGEST_FILE_BYTES), Entries()
        if not isinstance(attributes, dict):
            raise InputError(f"{path / INDEX}: no list of frames, expected an object")
        for name in ("frames", "lost"):
            lines = attributes.pop(name, None)
            if not isinstance(lines, list):
                raise InputError(f"{path / INDEX}: no list of frames, expected {name!r} in it")
            for line in lines:
                entries.note(line, path / INDEX)
        return attributes, entries
