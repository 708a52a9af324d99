"""Decode pictures, videos and the stream of a camera into a folder of light fields."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.core.console.reporter import SILENT, Reporter
from mirrorcam.core.disk.fingerprint import path_digest
from mirrorcam.core.disk.output_folder import OutputFolder, output_folder
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import is_picture, read_image, write_image
from mirrorcam.core.video.camera_addresses import open_camera, without_password
from mirrorcam.core.video.frames import MAX_KEPT, Frame
from mirrorcam.core.video.stream_losses import Stream
from mirrorcam.core.video.video_files import open_video
from mirrorcam.lightfield.epipolar_images import write_epi
from mirrorcam.lightfield.requests import DecodeRequest
from mirrorcam.lightfield.stream_recording import Show, StreamRecorder, check_outputs
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, VideoDepth
from mirrorcam.optics.light_field.equalisation import LINEAR, Equalisation, measure
from mirrorcam.optics.light_field.frame_checks import check_frames
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.io.recording import NothingDecoded
from mirrorcam.optics.light_field.io.stream import RecordingCheck
from mirrorcam.optics.light_field.io.view_images import tiled_views
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.robot.bag_recording import BagRecorder, refuse_bag
from mirrorcam.robot.rerun_viewer import RerunViewer

EQUALISATION = "equalisation.json"
MEASURED_FRAMES = 20
"""Number of frames of a video in which the brightness of its views is measured."""
MakeCheck = Callable[[Layout, Path, float | None, OutputFolder, Reporter], RecordingCheck | None]
"""Function that makes the check of recordings, if the layout permits one."""


def decode_files(
    frames: Sequence[Path],
    folder: Path,
    request: DecodeRequest = DecodeRequest(),
    reporter: Reporter = SILENT,
    *,
    layout: Path,
    force: bool = False,
    make_check: MakeCheck | None = None,
) -> int:
    """Decode pictures and videos, or the camera of a request, into a folder.

    Every input is checked before anything is written. A video whose decoding was interrupted is resumed. A damaged
    picture or frame is skipped and reported.

    Parameters
    ----------
    frames
        Pictures and videos with different names; empty if the request names a camera.
    layout
        The file `layout.json`, calibrated if possible.
    force
        Whether files that this command did not write may be replaced; recordings never are.
    make_check
        Function that makes the check of each recording; all pictures count as one recording.

    Returns
    -------
    int
        Number of damaged pictures and frames.

    Raises
    ------
    InputError
        If an input is missing or differs in size from the camera's pictures, if no picture can be decoded, or, without
        `force`, if a result would replace a file that this command did not write.
    """
    _check_sources(frames, request)
    with output_folder(folder, "decode", force=force) as output:
        return _decode_files(frames, layout, request, output, reporter, make_check)


def _check_sources(frames: Sequence[Path], request: DecodeRequest) -> None:
    if bool(frames) == (request.live is not None):
        raise InputError("expected frames, videos, or --live NUMBER or ADDRESS")
    names = [frame.stem for frame in frames]
    duplicate = next((name for name in names if names.count(name) > 1), None)
    if duplicate is not None:
        raise InputError(
            f"two frames are called {duplicate!r}, expected different names, because they name the light fields"
        )
    if request.epi and not any(map(is_picture, frames)):
        raise InputError("--epi: expected at least one picture among the frames")
    if request.to == "mcap" and (len(frames) > 1 or any(map(is_picture, frames))):
        raise InputError("--to mcap: expected one video or --live, because pictures have no times")


def _decode_files(
    frames: Sequence[Path],
    layout_file: Path,
    request: DecodeRequest,
    output: OutputFolder,
    reporter: Reporter,
    make_check: MakeCheck | None,
) -> int:
    layout = Layout.load(layout_file)
    check_frames(frames, layout, layout_file, lambda line: reporter.note("decode", line))
    images = [path for path in frames if is_picture(path)]
    check = None
    if make_check is not None:
        check = make_check(layout, layout_file, request.reference_depth_mm, output, reporter)
    _check_replaced_files(frames, request, output, check)
    decoder = _decoder(request, layout, layout_file)
    if layout.kind == "nominal":
        reporter.note(
            "decode",
            f"{layout_file} is a nominal layout, not a calibrated one: views are at their nominal positions",
        )
    estimator = None
    if not request.no_depth and (request.view or request.to == "mcap"):
        estimator = _estimator(decoder)
    viewer = RerunViewer.opened() if request.view else None

    def show(time_s: float, light_field: LightField) -> None:
        if viewer is not None:
            viewer.show(time_s, light_field, None if estimator is None else estimator.estimate(light_field))

    def show_video() -> Show:
        video = None if estimator is None else VideoDepth(estimator)

        def show_frame(time_s: float, light_field: LightField) -> None:
            if viewer is not None:
                viewer.show(time_s, light_field, None if video is None else video.estimate(light_field))

        return show_frame

    damaged = _decode_pictures(images, decoder, output, reporter, show, epi=request.epi) if images else 0
    if check is not None and images:
        check.report(read_undamaged(evenly_spaced(images)), check.file, "FRAMES")
    if decoder.equalisation is not None and _equalisation_file(request) is None:
        with output.staged(complete=False) as folder:
            decoder.equalisation.save(folder / EQUALISATION)
        reporter.note("decode", f"gains of the views written to {output.path / EQUALISATION}")
        if decoder.equalisation.exponent != LINEAR:
            curve = f"grey levels are proportional to light to the power of {decoder.equalisation.exponent:.2f}"
            reporter.note("decode", f"{curve}, and views are brightened accordingly towards their borders")
    recorder: StreamRecorder | BagRecorder
    if request.to == "mcap":
        on_frame = None if viewer is None else viewer.show
        recorder = BagRecorder(decoder, output, estimator, request.limit, reporter, check, on_frame)
    else:
        at_mm = request.regular_grid_at_mm
        recorder = StreamRecorder(decoder, output, request.to, request.limit, at_mm, reporter, check, show_video)
    return damaged + _record(frames, request, layout, recorder)


def _check_replaced_files(
    frames: Sequence[Path], request: DecodeRequest, output: OutputFolder, check: RecordingCheck | None
) -> None:
    """Raise InputError if results would replace recordings, or files that this command did not write."""
    images = [path for path in frames if is_picture(path)]
    endings = (".npz", "_views.png", *(("_epi.npz", "_epi.png") if request.epi else ()))
    output.refuse_others(*(f"{glob.escape(path.stem)}{ending}" for path in images for ending in endings))
    if images and check is not None:
        output.refuse_others(check.file)
    if request.equalise and _equalisation_file(request) is None:
        output.refuse_others(EQUALISATION)
    if request.to == "mcap":
        refuse_bag(_live_name(request.live) if request.live is not None else frames[0].stem, output, check)
    else:
        check_outputs([path.stem for path in frames if path not in images], request.to, output, check)


def _record(
    frames: Sequence[Path], request: DecodeRequest, layout: Layout, recorder: StreamRecorder | BagRecorder
) -> int:
    """Record the streams and return the number of lost frames; a stream without a usable frame counts as one.

    Raises NothingDecoded if neither a stream nor a picture has a usable frame.
    """
    lost, last_error, decoded = 0, None, any(map(is_picture, frames))
    for source, name, origin in _streams(frames, request.live, layout, recorder.reporter):
        try:
            lost += recorder.record(source, name, origin)
            decoded = True
        except NothingDecoded as error:
            lost, last_error = lost + 1, error
            recorder.reporter.note("decode", f"{error}; skipped")
    if last_error is not None and not decoded:
        raise last_error
    return lost


def _estimator(decoder: Decoder) -> DepthEstimator:
    """Return the depth estimator for all frames."""
    samples = np.zeros((*decoder.weights.shape, 3), np.uint8)
    light_field = LightField.of(decoder.views, samples, decoder.weights)
    return DepthEstimator(light_field, quality="fast")


def _decode_pictures(
    images: Sequence[Path], decoder: Decoder, output: OutputFolder, reporter: Reporter, show: Show, *, epi: bool
) -> int:
    """Decode pictures, show them one second apart, and return the number of damaged ones, which are skipped.

    Raises InputError if all are damaged.
    """
    damaged: list[str] = []
    with reporter.work("decode", count_text(len(images), "frame"), "frames") as advance:
        for done, path in enumerate(images, start=1):
            try:
                with output.staged(complete=False) as folder:
                    light_field = decode_picture(path, decoder, folder, epi=epi)
                show(done - 1.0, light_field)
            except DamagedPicture as error:
                damaged.append(str(error))
            advance(done, len(images))
    for reason in damaged:
        reporter.note("decode", f"{reason}; skipped")
    if len(damaged) == len(images):
        raise InputError(f"{damaged[0]}; all pictures are damaged" if len(images) > 1 else damaged[0])
    if damaged:
        reporter.note("decode", f"{len(damaged)} of {len(images)} pictures skipped as damaged")
    reporter.note("decode", f"light fields (.npz) and tiled views (_views.png) written to {output.path}")
    return len(damaged)


def evenly_spaced(paths: Sequence[Path]) -> list[Path]:
    """Choose a few evenly spaced pictures."""
    indices = np.unique(np.linspace(0, len(paths) - 1, min(len(paths), MAX_KEPT)).round().astype(int))
    return [paths[index] for index in indices]


def read_undamaged(paths: Sequence[Path]) -> list[Any]:
    """Read the pictures that are not damaged."""
    frames = []
    for path in paths:
        with suppress(DamagedPicture):
            frames.append(read_image(path))
    return frames


def decode_picture(path: Path, decoder: Decoder, folder: Path, *, epi: bool = False) -> LightField:
    """Decode a picture into NAME.npz and NAME_views.png of a folder, and return its light field.

    With `epi`, also write the epipolar-plane image of the middle row.
    """
    light_field = decoder.decode(read_image(path))
    save_npz(folder / f"{path.stem}.npz", light_field)
    write_image(folder / f"{path.stem}_views.png", tiled_views(light_field))
    if epi:
        write_epi(folder, path.stem, light_field)
    return light_field


def _equalisation_file(request: DecodeRequest) -> Path | None:
    """Return the equalisation.json of a request, if it names one instead of pictures."""
    return request.equalise[0] if [path.suffix for path in request.equalise] == [".json"] else None


def _decoder(request: DecodeRequest, layout: Layout, layout_file: Path) -> Decoder:
    """Return the decoder of a request, equalised if requested."""
    equalisation_file = _equalisation_file(request)
    if equalisation_file is None:
        check_frames(request.equalise, layout, layout_file)
    decoder = Decoder(
        layout,
        field=request.field,
        width_px=request.width_px,
        reference_depth_mm=request.reference_depth_mm,
        regular_grid_at_mm=request.regular_grid_at_mm,
    )
    if not request.equalise:
        return decoder
    return decoder.equalised(
        Equalisation.load(equalisation_file)
        if equalisation_file
        else measure(_sample_light_fields(request.equalise, decoder))
    )


def _sample_light_fields(paths: Sequence[Path], decoder: Decoder) -> Iterator[LightField]:
    """Yield the light fields of pictures and of the first frames of videos."""
    for path in paths:
        if is_picture(path):
            yield decoder.decode(read_image(path))
        else:
            frames = (item for item in open_video(path).frames() if isinstance(item, Frame))
            first = next(frames, None)
            if first is None:
                raise NothingDecoded(f"{path}: no frame could be decoded, expected at least one")
            for frame in chain((first,), islice(frames, MEASURED_FRAMES - 1)):
                yield decoder.decode(frame.pixels)


def _live_name(live: str) -> str:
    """Return the name of a camera's recording."""
    return f"device{live}" if live.isascii() and live.isdigit() else "stream"


def _streams(
    frames: Sequence[Path], live: str | None, layout: Layout, reporter: Reporter
) -> Iterator[tuple[Stream, str, dict[str, Any]]]:
    """Yield each video and the camera, with its name and the provenance for its recording."""
    for path in frames:
        if not is_picture(path):
            video = open_video(path, lambda line: reporter.note("decode", line))
            if video.sample_bits.largest:
                reporter.note("decode", f"{path.name}: {video.sample_bits}")
            yield video, path.stem, {"file": path.name, "sha256": path_digest(video.path), "rate_hz": video.rate_hz}
    if live is not None:
        size = layout.camera.width_px, layout.camera.height_px
        device = open_camera(live, *size, on_note=lambda line: reporter.note("decode", line))
        yield device, _live_name(live), {"device": without_password(live), "started": datetime.now(UTC).isoformat()}
