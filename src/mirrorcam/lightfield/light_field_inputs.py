"""The input light fields of a command: files, folders, recordings and frames of the camera."""

from __future__ import annotations

import glob
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.core.console.reporter import SILENT, Reporter
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.pictures import is_picture, line_on_bits
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.equalisation import Equalisation, equalised, needed_equalisation
from mirrorcam.optics.light_field.io.formats.registry import open_light_fields
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.temporal import TemporalFilter


@dataclass(frozen=True)
class NamedLightField:
    """A light field, the name of its results, and the depth range and time stated in its file.

    `frame` is the index, from 0, of a frame of a recording; None for other light fields.
    """

    name: str
    light_field: LightField
    depth_range_mm: tuple[float, float] | None = None
    time_s: float | None = None
    frame: int | None = None

    def depths_to_search(self, near_mm: float | None, far_mm: float | None) -> tuple[float | None, float | None]:
        """Return the requested depths, or else those of the file."""
        near, far = self.depth_range_mm or (None, None)
        return near if near_mm is None else near_mm, far if far_mm is None else far_mm


@dataclass(frozen=True)
class LightFieldInputs:
    """Files and folders of light fields, whose different names name the results.

    `layout` is the `layout.json` for decoding frames of the camera. `reporter` gets remarks on views that are reordered
    or matched in brightness. `assumed` is the geometry of views that files do not state.
    """

    paths: tuple[Path, ...]
    layout: Path | None = None
    reporter: Reporter = SILENT
    assumed: Assumed = NOTHING

    def __post_init__(self) -> None:
        names = [path.stem for path in self.paths]
        duplicate = next((name for name in names if names.count(name) > 1), None)
        if duplicate is not None:
            raise InputError(
                f"two light fields are called {duplicate!r}, expected different names, because they name the results"
            )

    @property
    def count_text(self) -> str:
        """Number of light fields, in words."""
        return count_text(len(self.paths), "light field")

    def open_all(self, progress: Progress = no_progress) -> Iterator[NamedLightField]:
        """Open the light fields one by one; `progress` is called after each file or folder.

        Raises InputError for a file that is not a light field, and for a frame without a layout.
        """
        has_frames = any(is_picture(path) for path in self.paths)
        decoder = Decoder(Layout.load(self.layout)) if self.layout is not None and has_frames else None
        for done, path in enumerate(self.paths, start=1):
            yield from open_inputs(path, decoder, self.reporter, self.assumed)
            progress(done, len(self.paths))

    def open_for(
        self, output: OutputFolder, endings: Sequence[str], progress: Progress = no_progress
    ) -> Iterator[NamedLightField]:
        """Open the light fields as `open_all` does, unless a result NAME_ENDING would replace a file of another
        program.

        Raises InputError in that case, before the first light field is opened, or for a folder, whose light fields are
        listed later, when one is opened.
        """
        names = [path.stem for path in self.paths if not path.is_dir()]
        output.refuse_others(*(f"{glob.escape(name)}_{ending}" for name in names for ending in endings))
        for named in self.open_all(progress):
            output.refuse_others(*(f"{glob.escape(named.name)}_{ending}" for ending in endings))
            yield named


class RecordingFilter:
    """Filters the frames of each recording in time, and returns other light fields unchanged.

    All frames must be passed in order, as each result depends on earlier frames.
    """

    def __init__(self) -> None:
        self._filter = TemporalFilter()

    def filtered(self, named: NamedLightField) -> LightField:
        """Return the light field in which to estimate depth."""
        if named.frame is None:
            return named.light_field
        if named.frame == 0:
            self._filter = TemporalFilter()
        return self._filter.filtered(named.light_field)


def open_inputs(
    path: Path, decoder: Decoder | None, reporter: Reporter = SILENT, assumed: Assumed = NOTHING
) -> Iterator[NamedLightField]:
    """Open the light fields of a file or folder; a recording has one per frame.

    Views that differ visibly in brightness or colour are matched to the central view, in a recording according
    to its first frame, and reported; others are returned exactly as stored.
    """
    contents = open_light_fields(path, assumed=assumed, decoder=decoder)
    name = path.name if path.is_dir() and not contents.is_recording else path.stem
    bits = line_on_bits(path)
    if bits is not None:
        reporter.note("views", f"{name}: {bits}")
    for note in contents.notes:
        reporter.note("views", f"{name}: {note}")
    equalisation: Equalisation | None = None
    for number, light_field in enumerate(contents.frames):
        result_name = f"{name}_{number:06d}" if contents.is_recording else name
        time_s = None if contents.times_s is None else contents.times_s[number]
        if number == 0:
            equalisation = needed_equalisation(light_field)
            if equalisation is not None:
                max_difference = np.abs(equalisation.gain - 1.0).max()
                reporter.note(
                    "views", f"{name}: views differ by up to {max_difference:.0%} in brightness or colour, matched"
                )
        matched = light_field if equalisation is None else equalised(light_field, equalisation)
        yield NamedLightField(
            result_name, matched, contents.depth_range_mm, time_s, number if contents.is_recording else None
        )
