"""Pictures, videos and a camera's stream become light fields in a folder."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain, islice
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mirrorcam.core.console.reporter import SILENT, Reporter
from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.disk.output_folder import OutputFolder, output_folder
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.images.pictures import is_picture, read_image, write_image
from mirrorcam.core.values import InputError
from mirrorcam.core.video.camera_addresses import camera, shown
from mirrorcam.core.video.frames import MOST, Frame
from mirrorcam.core.video.stream_losses import Stream
from mirrorcam.core.video.video import Video
from mirrorcam.lightfield.stream_recording import Show, StreamFormat, StreamRecorder, refuse_streams
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.depth import DepthEstimator, VideoDepth
from mirrorcam.optics.light_field.equalisation import LINEAR, Equalisation, measure
from mirrorcam.optics.light_field.frame_checks import check_frames
from mirrorcam.optics.light_field.io.bag_writer import Compression
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


@dataclass(frozen=True)
class DecodeRequest:
    """Selection of frames to decode into light fields, and the settings of decoding.

    Parameters
    ----------
    layout
        `layout.json`, calibrated where there is one.
    frames
        Pictures and videos of the camera.
    device
        Number or address of a camera, which is recorded until it is interrupted.
    limit
        Largest number of frames of a video or camera that are decoded.
    to
        What a video becomes: a Zarr group, or folders in another tool's format.
    field
        What views show at the reference depth: what all of them see, or what any sees.
    width_px
        Width of every view; None: as sharp as the frame.
    reference_depth_mm
        Depth of zero disparity, from the pupil; None: midway between those of the design, or where the board was.
    regular_grid_at_mm
        Depth at which views are moved to an even grid; None: they stay in place.
    equalise
        Pictures or videos in which the brightness of the views is measured, or one equalisation.json.
    mcap
        ROS 2 bag that the video or the camera becomes, in place of light fields in a folder.
    mcap_compression
        How chunks of the bag are compressed.
    view
        Whether what is decoded is shown in a window.
    depth
        Whether depth is measured for the bag and the window.
    near_mm, far_mm
        Depths between which it is searched, as of `DepthEstimator`.
    """

    layout: Path
    frames: tuple[Path, ...] = ()
    device: str | None = None
    limit: int | None = None
    to: StreamFormat = "zarr"
    field: Literal["common", "union"] = "common"
    width_px: int | None = None
    reference_depth_mm: float | None = None
    regular_grid_at_mm: float | None = None
    equalise: tuple[Path, ...] = ()
    mcap: Path | None = None
    mcap_compression: Compression = "none"
    view: bool = False
    depth: bool = True
    near_mm: float | None = None
    far_mm: float | None = None


MakeCheck = Callable[[Layout, Path, float | None, OutputFolder, Reporter], RecordingCheck | None]
"""Makes the check of recordings from the layout, its file and the depth of decoding, where the layout allows one."""


def decode_files(
    request: DecodeRequest,
    folder: Path,
    reporter: Reporter = SILENT,
    *,
    force: bool = False,
    make_check: MakeCheck | None = None,
) -> int:
    """Decode pictures, videos and a camera into a folder; of each, the views in one picture beside the light field.

    Every input is checked before anything is written. A video whose decoding was interrupted is resumed. A damaged
    picture or frame is left out and reported; returns their number. `make_check` makes the check of each recording, and
    of the pictures as one.

    Raises InputError for an input that is missing, or not of the layout's camera, where no picture is left, and,
    without `force`, where a file of others is in the way.
    """
    with output_folder(folder if request.mcap is None else request.mcap.parent, "decode", force=force) as output:
        return _decode_files(request, output, reporter, make_check)


def _decode_files(
    request: DecodeRequest, output: OutputFolder, reporter: Reporter, make_check: MakeCheck | None
) -> int:
    layout = Layout.load(request.layout)
    check_frames(request.frames, layout, request.layout, lambda line: reporter.note("decode", line))
    images = [path for path in request.frames if is_picture(path)]
    check = None
    if make_check is not None:
        check = make_check(layout, request.layout, request.reference_depth_mm, output, reporter)
    _refuse_blocked(request, images, output, check)
    decoder = _decoder(request, layout)
    if layout.kind == "nominal":
        reporter.note(
            "decode",
            f"{request.layout} is a nominal layout, not a calibrated one: views are at their nominal positions",
        )
    estimator = _estimator(decoder, request) if request.depth and (request.mcap or request.view) else None
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

    damaged = _decode_pictures(images, decoder, output, reporter, show) if images else 0
    if check is not None and images:
        check.report(readable(spread(images)), check.file, "FRAMES")
    if decoder.equalisation is not None and _equalisation_file(request) is None:
        with output.staged(complete=False) as folder:
            decoder.equalisation.save(folder / EQUALISATION)
        reporter.note("decode", f"gains of the views written to {output.path / EQUALISATION}")
        if decoder.equalisation.exponent != LINEAR:
            curve = f"grey levels grow as light to the power of {decoder.equalisation.exponent:.2f}"
            reporter.note("decode", f"{curve}, and views are brightened so towards their borders")
    recorder: StreamRecorder | BagRecorder
    if request.mcap is None:
        at_mm = request.regular_grid_at_mm
        recorder = StreamRecorder(decoder, output, request.to, request.limit, at_mm, reporter, check, show_video)
    else:
        path, compression, seen = request.mcap, request.mcap_compression, None if viewer is None else viewer.show
        recorder = BagRecorder(decoder, output, path, compression, estimator, request.limit, reporter, check, seen)
    return damaged + _record(request, layout, recorder)


def _refuse_blocked(
    request: DecodeRequest, images: Sequence[Path], output: OutputFolder, check: RecordingCheck | None
) -> None:
    """Raise InputError where files of others, or recordings, are in the place of results."""
    output.refuse_others(*(glob.escape(name) for path in images for name in picture_files(path)))
    if images and check is not None:
        output.refuse_others(check.file)
    if request.equalise and _equalisation_file(request) is None:
        output.refuse_others(EQUALISATION)
    if request.mcap is None:
        refuse_streams([path.stem for path in request.frames if path not in images], request.to, output, check)
    else:
        refuse_bag(request.mcap, request.frames, output, check)


def _record(request: DecodeRequest, layout: Layout, recorder: StreamRecorder | BagRecorder) -> int:
    """Decode the streams; one without a frame that can be used counts as one lost, and is an error where all are so."""
    lost, nothing, decoded = 0, None, any(map(is_picture, request.frames))
    for source, name, origin in _streams(request, layout, recorder.reporter):
        try:
            lost += recorder.record(source, name, origin)
            decoded = True
        except NothingDecoded as error:
            lost, nothing = lost + 1, error
            recorder.reporter.note("decode", f"{error}; skipped")
    if nothing is not None and not decoded:
        raise nothing
    return lost


def _estimator(decoder: Decoder, request: DecodeRequest) -> DepthEstimator:
    """The estimator of the depth of all frames."""
    samples = np.zeros((*decoder.weights.shape, 3), np.uint8)
    light_field = LightField.of(decoder.views, samples, decoder.weights)
    return DepthEstimator(light_field, near_mm=request.near_mm, far_mm=request.far_mm, quality="fast")


def _decode_pictures(
    images: Sequence[Path], decoder: Decoder, output: OutputFolder, reporter: Reporter, show: Show
) -> int:
    """Decode pictures, but not the damaged ones, whose number is returned; raises InputError where all are.

    They are shown one second apart.
    """
    damaged: list[str] = []
    with reporter.work("decode", count_text(len(images), "frame"), "frames") as advance:
        for done, path in enumerate(images, start=1):
            try:
                with output.staged(complete=False) as folder:
                    light_field = decode_picture(path, decoder, folder)
                show(done - 1.0, light_field)
            except DamagedPicture as error:
                damaged.append(str(error))
            advance(done, len(images))
    for reason in damaged:
        reporter.note("decode", f"{reason}; skipped")
    if len(damaged) == len(images):
        raise InputError(f"{damaged[0]}; no picture is left to decode" if len(images) > 1 else damaged[0])
    if damaged:
        reporter.note("decode", f"{len(damaged)} of {len(images)} pictures skipped as damaged")
    reporter.note("decode", f"light fields (.npz) and tiled views (_views.png) written to {output.path}")
    return len(damaged)


def spread(paths: Sequence[Path]) -> list[Path]:
    """A few of many pictures, spread evenly."""
    places = np.unique(np.linspace(0, len(paths) - 1, min(len(paths), MOST)).round().astype(int))
    return [paths[place] for place in places]


def readable(paths: Sequence[Path]) -> list[Any]:
    """The pictures that are not damaged."""
    frames = []
    for path in paths:
        with suppress(DamagedPicture):
            frames.append(read_image(path))
    return frames


def picture_files(path: Path) -> tuple[str, str]:
    """Names of the light field of a picture, and of the picture of its views."""
    return f"{path.stem}.npz", f"{path.stem}_views.png"


def decode_picture(path: Path, decoder: Decoder, folder: Path) -> LightField:
    """Decode a picture into NAME.npz and NAME_views.png of a folder, and return its light field."""
    light_field = decoder.decode(read_image(path))
    samples, views = picture_files(path)
    save_npz(folder / samples, light_field)
    write_image(folder / views, tiled_views(light_field))
    return light_field


def _equalisation_file(request: DecodeRequest) -> Path | None:
    """The one equalisation.json of a request, where it names that in place of pictures."""
    return request.equalise[0] if [path.suffix for path in request.equalise] == [".json"] else None


def _decoder(request: DecodeRequest, layout: Layout) -> Decoder:
    """The decoder that a request asks for, equalised where it says so."""
    known = _equalisation_file(request)
    if known is None:
        check_frames(request.equalise, layout, request.layout)
    decoder = Decoder(
        layout,
        field=request.field,
        width_px=request.width_px,
        reference_depth_mm=request.reference_depth_mm,
        regular_grid_at_mm=request.regular_grid_at_mm,
    )
    if not request.equalise:
        return decoder
    return decoder.equalised(Equalisation.load(known) if known else measure(_sampled(request.equalise, decoder)))


def _sampled(paths: Sequence[Path], decoder: Decoder) -> Iterator[LightField]:
    """The light fields of pictures and of the first frames of videos."""
    for path in paths:
        if is_picture(path):
            yield decoder.decode(read_image(path))
        else:
            frames = (item for item in Video(path).frames() if isinstance(item, Frame))
            first = next(frames, None)
            if first is None:
                raise NothingDecoded(f"{path}: not one frame could be decoded, expected at least one")
            for frame in chain((first,), islice(frames, MEASURED_FRAMES - 1)):
                yield decoder.decode(frame.pixels)


def _streams(
    request: DecodeRequest, layout: Layout, reporter: Reporter
) -> Iterator[tuple[Stream, str, dict[str, Any]]]:
    """Each video and the camera, with a name and what the recording says of where it is from."""
    for path in request.frames:
        if not is_picture(path):
            video = Video(path, lambda line: reporter.note("decode", line))
            if video.sample_bits.largest:
                reporter.note("decode", f"{path.name}: {video.sample_bits}")
            yield video, path.stem, {"file": path.name, "sha256": file_digest(video.path), "rate_hz": video.rate_hz}
    if request.device is not None:
        size = layout.camera.width_px, layout.camera.height_px
        device = camera(request.device, *size, tell=lambda line: reporter.note("decode", line))
        name = f"device{request.device}" if request.device.isascii() and request.device.isdigit() else "stream"
        yield device, name, {"device": shown(request.device), "started": datetime.now(UTC).isoformat()}
