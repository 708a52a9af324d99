"""Light fields of a stream as one Zarr group, with a chunk per frame, readable by any program with Zarr v3."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.core.disk.array_files import check_bytes
from mirrorcam.core.disk.zarr_arrays import METADATA, ZarrArray, read_attributes
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened
from mirrorcam.optics.light_field.io.light_field_format import StoredFrames
from mirrorcam.optics.light_field.io.recording import JOURNAL, SCHEMA, Entries, read_journal
from mirrorcam.optics.light_field.io.views_file import light_field_of_fields
from mirrorcam.optics.light_field.light_field import LightField

DIMENSIONS = ("frame", "t", "s", "v", "u", "c")
COORDINATES = ("number", "time_s", "x_mm", "y_mm", "z_mm")
"""Arrays that label the samples: by frame, and by view."""
GROWTH_FRAMES = 256
"""Number of frames by which the array grows during writing."""
MAX_FRAMES = 10_000_000
"""Maximum number of frames of a recording that is read: days of video."""


class ZarrSink:
    """Stores a recording as a Zarr group.

    The group's attributes are the recording's metadata and `lost`; its arrays are `samples` (frame, t, s, v, u, c),
    `weights` (t, s, v, u), `number` and `time_s` (frame,), the frames' numbers in the source and times, and `x_mm`,
    `y_mm` and `z_mm` (t, s), the positions of the views. Xarray shows the last five as coordinates.
    """

    def open(self, folder: Path, about: dict[str, Any]) -> None:
        import zarr

        self._folder = folder
        self._samples: Any = None
        if (folder / "samples" / "zarr.json").exists():
            ZarrArray(folder, "samples")
            self._samples = zarr.open_array(folder / "samples", config={"write_empty_chunks": True})

    def write(self, index: int, number: int, light_field: LightField) -> None:
        if self._samples is None:
            self._samples = self._create(light_field)
        if index >= self._samples.shape[0]:
            self._samples.resize((index + GROWTH_FRAMES, *self._samples.shape[1:]))
        self._samples[index] = light_field.samples

    def close(self, folder: Path, about: dict[str, Any], entries: Entries) -> None:
        import zarr

        for stale in folder.rglob("*.partial"):
            stale.unlink()
        self._samples.resize((len(entries.numbers), *self._samples.shape[1:]))
        group = zarr.open_group(folder, mode="r+")
        for name, values in (("number", np.array(entries.numbers)), ("time_s", np.array(entries.times_s))):
            group.create_array(name, data=values, dimension_names=("frame",), overwrite=True)
        # As xarray reads the conventions for climate data: coordinates of the samples that are not indices.
        self._samples.attrs["coordinates"] = " ".join(COORDINATES)
        group.attrs.update({**about, "lost": [[number, reason] for number, reason in sorted(entries.lost.items())]})

    def read(self, path: Path) -> tuple[dict[str, Any], Entries]:
        """Read the group's attributes and arrays."""
        if not (path / METADATA).exists():
            raise InputError(f"{path}: not a recording of light fields, expected {METADATA} in it")
        attributes = read_attributes(path)
        if attributes.get("schema") != SCHEMA:
            raise InputError(f"{path}: not a recording of light fields, expected the schema {SCHEMA!r}")
        number, time_s = (_frame_array(path, name, kind) for name, kind in (("number", "int64"), ("time_s", "float64")))
        lost = attributes.pop("lost", None)
        if not isinstance(lost, list) or not all(isinstance(entry, list) and len(entry) == 2 for entry in lost):
            raise InputError(f"{path}: its attribute 'lost' is not a list of frames and reasons")
        if number.shape != time_s.shape or (len(number) > 1 and not np.ptp(time_s)):
            raise InputError(
                f"{path}: {len(number)} frame numbers and {len(time_s)} times, expected one time per frame"
            )
        lines = [
            {"number": frame, "time_s": time} for frame, time in zip(number.tolist(), time_s.tolist(), strict=True)
        ]
        lines += [{"number": frame, "lost": reason} for frame, reason in lost]
        return attributes, Entries.of(lines, path)

    def _create(self, light_field: LightField) -> Any:
        """Create the arrays before the first frame."""
        import zarr
        from zarr.codecs import BloscCodec

        group = zarr.open_group(self._folder, mode="a")
        weights = group.create_array(
            "weights", data=light_field.weights, dimension_names=DIMENSIONS[1:5], overwrite=True
        )
        weights.attrs["coordinates"] = " ".join(COORDINATES[2:])
        for axis, name in enumerate(COORDINATES[2:]):
            values = np.ascontiguousarray(light_field.positions_mm[..., axis])
            group.create_array(name, data=values, dimension_names=DIMENSIONS[1:3], overwrite=True)
        # Pictures hardly compress: this fast codec mainly removes the parts of views without samples.
        codec = BloscCodec(cname="lz4", clevel=1, shuffle="noshuffle")
        shape = light_field.samples.shape
        return group.create_array(
            "samples",
            shape=(GROWTH_FRAMES, *shape),
            chunks=(1, *shape),
            dtype=light_field.samples.dtype,
            compressors=codec,
            dimension_names=DIMENSIONS,
            overwrite=True,
            # Testing a frame for zeros takes three times as long as writing it.
            config={"write_empty_chunks": True},
        )


def _frame_array(path: Path, name: str, kind: str) -> Any:
    """Return an array with a number per frame."""
    array = ZarrArray(path, name)
    if len(array.shape) != 1 or array.dtype != kind or array.shape[0] > MAX_FRAMES:
        raise InputError(f"{path}: {name} is {array.dtype} of shape {array.shape[:8]}, expected {kind} (frame,)")
    return array.read()


class StoredLightFields(StoredFrames):
    """The light fields of a recording in Zarr, each read on access.

    An interrupted recording (NAME.partial) contains its complete frames.

    Attributes
    ----------
    numbers, times_s
        Numbers and times of the frames in the source.
    lost
        Frames of the source that could not be used, with the reasons.
    about
        Metadata of the recording.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        journal = path / JOURNAL
        self.about, entries = read_journal(journal) if journal.exists() else ZarrSink().read(path)
        self.numbers, self.times_s, self.lost = tuple(entries.numbers), tuple(entries.times_s), entries.lost
        self._samples, weights = ZarrArray(path, "samples"), ZarrArray(path, "weights")
        self._check_shapes(weights, is_interrupted=journal.exists())
        self._has_all_weights = weights.is_complete
        views = self.about.get("views")
        empty = np.zeros(self._samples.shape[1:], dtype=self._samples.dtype)
        fields = {**(views if isinstance(views, dict) else {}), "samples": empty, "weights": weights.read()}
        self._empty = light_field_of_fields(fields, str(path))

    def _check_shapes(self, weights: ZarrArray, *, is_interrupted: bool) -> None:
        """Raise InputError if arrays are inconsistent, or a frame is not a single chunk that fits into memory."""
        shape, count = self._samples.shape, len(self.numbers)
        if len(shape) != 6 or self._samples.chunk_shape != (1, *shape[1:]):
            raise InputError(
                f"{self.path}: samples have shape {shape[:8]}, expected {DIMENSIONS} with a chunk per frame"
            )
        if weights.shape != shape[1:5] or weights.dtype != np.float32:
            raise InputError(
                f"{self.path}: weights are {weights.dtype} of shape {weights.shape[:8]}, expected float32 {shape[1:5]}"
            )
        if shape[0] != count and not (is_interrupted and shape[0] > count):
            raise InputError(f"{self.path}: samples for {shape[0]} frames, but numbers and times for {count}")
        check_bytes(self.path, self._samples.chunk_bytes + weights.dtype.itemsize * int(np.prod(shape[1:5])), 0)

    def __len__(self) -> int:
        return len(self.numbers)

    def _frame(self, index: int) -> LightField:
        chunk = (index, 0, 0, 0, 0, 0)
        if not self._samples.has(chunk):
            raise InputError(f"{self.path}: frame {index} is missing, expected {self._samples.key(chunk)}")
        try:
            samples = self._samples.chunk(chunk)[0]
            if not self._has_all_weights and samples[self._empty.weights == 0].any():
                raise InputError("has samples without weight, expected the files of all weights")
            return LightField.of(self._empty, samples, self._empty.weights)
        except InputError as error:
            reason = str(error).removeprefix(f"{self.path}/").removeprefix(f"{self.path}: ")
            raise InputError(shortened(f"{self.path}: frame {index} cannot be read: {reason}")) from None
