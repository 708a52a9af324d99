"""Light fields of a stream, written to disk frame by frame; an interrupted recording can be resumed."""

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
from mirrorcam.core.disk.fingerprint import differing_keys
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
    """Return a recording's attributes in JSON's types: its views and source, and the settings used for decoding."""
    return {"schema": SCHEMA, "source": source, **settings, "views": fields_of_views(views)}


class NothingDecoded(InputError):
    """Raised if no frame of a source could be decoded."""


class _Frame(Value):
    """A line of the journal: a written frame with its time, or a lost frame with the reason."""

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
    """The frames of a recording, in order: numbers in the source and times in s; and lost frames with reasons."""

    numbers: list[int] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)
    lost: dict[int, str] = field(default_factory=dict)

    @classmethod
    def of(cls, lines: Iterable[Any], where: Path) -> Entries:
        """Parse the lines of a journal; raises a one-line InputError if they are invalid."""
        entries = cls()
        for line in lines:
            entries.add(line, where)
        numbers = [*entries.numbers, *entries.lost]
        if entries.numbers != sorted(entries.numbers) or len(set(numbers)) != len(numbers):
            raise InputError(f"{where}: frame numbers do not increase, expected each once and in order")
        return entries

    def add(self, line: Any, where: Path) -> None:
        """Add a line of the journal; raises InputError if it is invalid."""
        try:
            frame = _Frame.model_validate(line, strict=True)
        except InvalidValue as error:
            raise InputError(f"{where}: not a list of frames: {error}") from None
        if frame.lost is not None:
            self.lost[frame.number] = frame.lost
        else:
            assert frame.time_s is not None
            self.numbers.append(frame.number)
            self.times_s.append(frame.time_s)

    @property
    def last(self) -> int:
        """Highest frame number, written or lost; -1 before the first."""
        return max((*self.numbers[-1:], *self.lost), default=-1)


class Sink(Protocol):
    """Storage of light fields in a folder. Equal calls must produce equal bytes."""

    def open(self, folder: Path, about: dict[str, Any]) -> None:
        """Begin or resume in a folder; data at the index of the next `write` may be incomplete."""

    def write(self, index: int, number: int, light_field: LightField) -> None:
        """Add the light field at an index that increases without gaps, for frame `number` of the source."""

    def close(self, folder: Path, about: dict[str, Any], entries: Entries) -> None:
        """Write the data known only at the end, such as `entries`."""

    def read(self, path: Path) -> tuple[dict[str, Any], Entries]:
        """Read the attributes of a recording and its frames, as written by `close`."""


class Recording:
    """Light fields being written to `path`.

    Until `finish`, they are in `path` + ".partial", with a journal of one line per completely written frame.
    Reopened with the same `about`, writing resumes after these frames, and ends in the same bytes as without the
    interruption.

    Attributes
    ----------
    entries
        Journal entries of the frames written.
    is_complete
        Whether `path` already existed, written with the same `about`, so nothing remains to be done.

    Raises
    ------
    InputError
        If `path` or its partial folder belongs to a different job, or cannot be written.
    """

    def __init__(self, path: Path, about: dict[str, Any], sink: Sink) -> None:
        self.path, self._sink = path, sink
        self._about = json.loads(json.dumps(about, allow_nan=False))
        self._folder = path.with_name(path.name + ".partial")
        self._journal: TextIO | None = None
        self.entries = Entries()
        self.is_complete = path.exists()
        for folder in (path, self._folder):
            link = folder if folder.is_symlink() else linked(folder)
            if link is not None:
                raise InputError(
                    f"{link}: is a link, but a recording must consist of files and folders: give a new name"
                )
        if self.is_complete:
            attributes, self.entries = sink.read(path)
            if other := differing_keys(attributes, self._about):
                raise InputError(
                    f"{path}: exists and holds something else, give a new name or repeat the same job: "
                    f"{' and '.join(other)} differ"
                )
            # The journal remains if a run was interrupted after the folder was renamed.
            (path / JOURNAL).unlink(missing_ok=True)
            return
        journal = self._folder / JOURNAL
        lines = read_complete_lines(journal)
        if lines and (other := differing_keys(lines[0], self._about)):
            raise InputError(
                f"{self._folder}: is the beginning of a different job, repeat the same job or remove the folder: "
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
        """Write the light field of a frame, then its journal line, which marks it as complete."""
        with self._writing():
            self._sink.write(len(self.entries.numbers), frame.number, light_field)
            self._note({"number": frame.number, "time_s": frame.time_s})

    def add_lost(self, lost: Lost) -> None:
        """Record a frame that cannot be used."""
        with self._writing():
            self._note({"number": lost.number, "lost": lost.reason})

    def finish(self) -> None:
        """Rename the folder to `path`; if there are no frames, remove it and raise NothingDecoded."""
        self.close()
        if not self.entries.numbers:
            shutil.rmtree(self._folder)
            name = self._about["source"].get("file", self.path.name)
            raise NothingDecoded(f"{name}: no frame could be decoded, expected at least one")
        with self._writing():
            self._sink.close(self._folder, self._about, self.entries)
            self._folder.rename(self.path)
            (self.path / JOURNAL).unlink()

    def close(self) -> None:
        """Close the journal; the recording can be resumed."""
        if self._journal is not None:
            self._journal.close()

    def _note(self, line: dict[str, Any]) -> None:
        assert self._journal is not None
        self._journal.write(json.dumps(line) + "\n")
        self._journal.flush()
        self.entries.add(line, self._folder / JOURNAL)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        resumable = "written so far are complete, and the same command resumes after them"
        try:
            # Zarr leaves writes unfinished if a signal's exception interrupts it.
            with deferred():
                yield
        except InputError as error:
            raise InputError(f"{error}; {len(self.entries.numbers)} frames {resumable}") from None
        except OSError as error:
            reason = error.strerror or error
            raise InputError(
                f"{self.path}: cannot be written: {reason}; {len(self.entries.numbers)} frames {resumable}"
            ) from None


def read_journal(journal: Path) -> tuple[dict[str, Any], Entries]:
    """Return attributes and frames of an interrupted recording, up to its last complete journal line."""
    lines = read_complete_lines(journal)
    if not lines or lines[0].get("schema") != SCHEMA:
        raise InputError(f"{journal}: not the journal of a recording, expected the schema {SCHEMA!r} in its first line")
    return lines[0], Entries.of(lines[1:], journal)


def read_complete_lines(journal: Path) -> list[dict[str, Any]]:
    """Return the journal's lines up to the first incomplete one; none without a journal.

    Raises InputError for a line that is not a JSON object.
    """
    if not journal.exists():
        return []
    lines: list[dict[str, Any]] = []
    for line in read_lines(journal)[:-1]:
        try:
            lines.append(json_of(journal, line))
        except InputError:
            break
        if not isinstance(lines[-1], dict):
            raise InputError(f"{journal}: holds {str(lines[-1])[:40]!r}, expected lines of a journal")
    return lines


class Folders:
    """A sink with one folder per frame, named by its number in the source, and `frames.json`.

    Parameters
    ----------
    write_frame
        Function that writes a light field to an empty folder.
    """

    def __init__(self, write_frame: Callable[[Path, LightField], None]) -> None:
        self._write_one = write_frame

    def open(self, folder: Path, about: dict[str, Any]) -> None:
        self._folder = folder

    def write(self, index: int, number: int, light_field: LightField) -> None:
        """Write the frame's folder, replacing one that an interrupted run left."""
        final, partial = self._folder / f"{number:06d}", self._folder / f"{number:06d}.partial"
        for stale in (final, partial):
            if stale.exists():
                shutil.rmtree(stale)
        partial.mkdir()
        self._write_one(partial, light_field)
        partial.rename(final)

    def close(self, folder: Path, about: dict[str, Any], entries: Entries) -> None:
        """Write `frames.json`: the attributes of the recording, and its frames."""
        for stale in folder.glob("*.partial"):
            shutil.rmtree(stale)
        frames = [
            {"number": number, "time_s": time_s, "folder": f"{number:06d}"}
            for number, time_s in zip(entries.numbers, entries.times_s, strict=True)
        ]
        lost = [{"number": number, "lost": reason} for number, reason in sorted(entries.lost.items())]
        write_json(folder / INDEX, {**about, "frames": frames, "lost": lost})

    def read(self, path: Path) -> tuple[dict[str, Any], Entries]:
        """Read `frames.json`."""
        if not path.is_dir() or not (path / INDEX).exists():
            raise InputError(f"{path}: exists and is not a folder of light fields, give a new name")
        attributes, entries = read_json(path / INDEX, LARGEST_FILE_BYTES), Entries()
        if not isinstance(attributes, dict):
            raise InputError(f"{path / INDEX}: not a list of frames, expected an object")
        for name in ("frames", "lost"):
            lines = attributes.pop(name, None)
            if not isinstance(lines, list):
                raise InputError(f"{path / INDEX}: not a list of frames, expected {name!r} in it")
            for line in lines:
                entries.add(line, path / INDEX)
        return attributes, entries
