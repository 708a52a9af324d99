"""Light fields of a stream as one Zarr group: a chunk per frame, which any program with Zarr v3 reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.recording import JOURNAL, SCHEMA, Entries, whole_lines
from mirrorcam.optics.light_field.io.views_file import light_field_of_fields
from mirrorcam.optics.light_field.light_field import LightField

DIMENSIONS = ("frame", "t", "s", "v", "u", "c")
GROWTH_FRAMES = 256
"""Number of frames that the array grows by at once while it is written."""


class ZarrSink:
    """Group attributes: `about`, and `lost`. Arrays: `samples` (frame, t, s, v, u, c), `weights` (t, s, v, u), and
    `number` and `time_s` (frame,), the frames' numbers in the source and times.
    """

    def open(self, folder: Path, about: dict[str, Any]) -> None:
        import zarr

        self._folder = folder
        self._samples: Any = None
        if (folder / "samples" / "zarr.json").exists():
            self._samples = zarr.open_array(folder / "samples", config={"write_empty_chunks": True})

    def write(self, index: int, number: int, light_field: LightField) -> None:
        if self._samples is None:
            self._samples = self._created(light_field)
        if index >= self._samples.shape[0]:
            self._samples.resize((index + GROWTH_FRAMES, *self._samples.shape[1:]))
        self._samples[index] = light_field.samples

    def close(self, folder: Path, about: dict[str, Any], entries: Entries) -> None:
        import zarr

        for left in folder.rglob("*.partial"):
            left.unlink()
        self._samples.resize((len(entries.numbers), *self._samples.shape[1:]))
        group = zarr.open_group(folder, mode="r+")
        for name, values in (("number", np.array(entries.numbers)), ("time_s", np.array(entries.times_s))):
            group.create_array(name, data=values, dimension_names=("frame",), overwrite=True)
        group.attrs.update({**about, "lost": [[number, reason] for number, reason in sorted(entries.lost.items())]})

    def read(self, path: Path) -> tuple[dict[str, Any], Entries]:
        """Read the group's attributes and arrays."""
        group = open_group(path)
        attributes = dict(group.attrs)
        if attributes.get("schema") != SCHEMA:
            raise InputError(f"{path}: not a recording of light fields, expected the schema {SCHEMA!r}")
        lost = {int(number): str(reason) for number, reason in attributes.pop("lost")}
        return attributes, Entries(group["number"][:].tolist(), group["time_s"][:].tolist(), lost)

    def _created(self, light_field: LightField) -> Any:
        """The arrays as they are before the first frame."""
        import zarr
        from zarr.codecs import BloscCodec

        group = zarr.open_group(self._folder, mode="a")
        group.create_array("weights", data=light_field.weights, dimension_names=DIMENSIONS[1:5], overwrite=True)
        # Pictures hardly shrink: what this fast codec gains is the parts of views without samples.
        fast = BloscCodec(cname="lz4", clevel=1, shuffle="noshuffle")
        shape = light_field.samples.shape
        return group.create_array(
            "samples",
            shape=(GROWTH_FRAMES, *shape),
            chunks=(1, *shape),
            dtype=light_field.samples.dtype,
            compressors=fast,
            dimension_names=DIMENSIONS,
            overwrite=True,
            # Looking whether a frame is all zero takes three times as long as writing it.
            config={"write_empty_chunks": True},
        )


def open_group(path: Path) -> Any:
    """The Zarr group of a recording, or InputError in one line."""
    import zarr

    try:
        group = zarr.open_group(path, mode="r")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a Zarr group that can be read: {error}") from None
    return group


class StoredLightFields(Sequence[LightField]):
    """The light fields of a recording in Zarr, read from disk one by one as they are asked for.

    A recording that was cut off (NAME.partial) holds the frames that are whole.

    Attributes
    ----------
    numbers, times_s
        Numbers and times of the frames in the source.
    lost
        Frames of the source that could not be used, with the reasons.
    about
        Description that the recording was written with.
    """

    def __init__(self, path: Path) -> None:
        group = open_group(path)
        self.path = path
        journal = path / JOURNAL
        if journal.exists():
            lines = whole_lines(journal)
            if not lines:
                raise InputError(f"{journal}: holds no line, expected the journal of a recording")
            self.about, entries = lines[0], Entries()
            for line in lines[1:]:
                entries.note(line, journal)
        else:
            self.about, entries = ZarrSink().read(path)
        self.numbers, self.times_s, self.lost = tuple(entries.numbers), tuple(entries.times_s), entries.lost
        self._samples = group["samples"]
        weights = np.asarray(group["weights"][:])
        empty = np.zeros((*weights.shape, self._samples.shape[-1]), dtype=self._samples.dtype)
        self._empty = light_field_of_fields(self.about["views"] | {"samples": empty, "weights": weights}, str(path))

    def __len__(self) -> int:
        return len(self.numbers)

    @overload
    def __getitem__(self, index: int) -> LightField: ...

    @overload
    def __getitem__(self, index: slice) -> list[LightField]: ...

    def __getitem__(self, index: int | slice) -> LightField | list[LightField]:
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"{self.path}: frame {index}, expected one of {len(self)}")
        number = index % len(self)
        chunk = self.path / "samples" / self._samples.metadata.encode_chunk_key((number, 0, 0, 0, 0, 0))
        if not chunk.exists():
            # Zarr would take it for all zero.
            raise InputError(f"{self.path}: frame {number} is missing, expected {chunk.relative_to(self.path)}")
        try:
            return LightField.of(self._empty, np.asarray(self._samples[number]), self._empty.weights)
        except (OSError, ValueError, RuntimeError) as error:
            raise InputError(f"{self.path}: frame {number} cannot be read: {error}") from None
