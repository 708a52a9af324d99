"""`mirrorcam decode`: from frames to light fields."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import groupby, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.console.progress import Advance, count_text, long_work, say
from mirrorcam.optics.base.values import InputError, Value

if TYPE_CHECKING:
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.optics.light_field.decoder import Decoder
    from mirrorcam.optics.light_field.equalisation import Equalisation
    from mirrorcam.optics.light_field.io.frames import Device, Video
    from mirrorcam.optics.light_field.io.recording import Recording, Sink
    from mirrorcam.optics.light_field.light_field import LightField

MANIFESTS = {"dataset.json": "mirrorcam.dataset/", "scene.json": "mirrorcam.scene/"}
EQUALISATION = "equalisation.json"
# Of a video, as many frames tell how bright the views are beside each other.
MEASURED_FRAMES = 20


class DecodeOptions(Value):
    """Decode pictures, videos or a camera's stream into light fields, with a picture of all views."""

    frames: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FRAME|VIDEO...", help_behavior_hint="")
    ] = Field(default=(), description="PNG or JPEG frames of the camera; videos of it, such as MP4 or AVI")
    layout: Path = Field(description="layout.json, calibrated where there is one")
    out: Path = Field(
        default=Path("output/decoded"),
        description=(
            "folder: of each frame NAME.npz (NumPy: samples (t, s, v, u, c), weights (t, s, v, u), positions_mm "
            "(t, s, 3) and the other fields of LightField), of each video NAME.zarr, of either NAME_views.png"
        ),
    )
    device: Annotated[int | None, tyro.conf.arg(metavar="NUMBER", help_behavior_hint="")] = Field(
        default=None, ge=0, description="a camera of this machine instead of files, until Ctrl-C: deviceNUMBER.zarr"
    )
    limit: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = Field(
        default=None, ge=1, description="how many frames of a video or a camera to decode at most"
    )
    to: Literal["zarr", "hci", "stanford"] = Field(
        default="zarr",
        description=(
            "what to write of a video: one Zarr group, or a folder NAME with, per frame, a scene in HCI format or a "
            "folder as of the Stanford gantry"
        ),
    )
    field: Literal["common", "union"] = Field(
        default="common", description="show what all views see at the reference depth, or what any view sees"
    )
    width_px: Annotated[int | None, tyro.conf.arg(metavar="PX", help_behavior_hint="(as sharp as the frame)")] = Field(
        default=None, ge=2, description="width of every view; its height follows"
    )
    reference_depth_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(midway between the design's)")
    ] = Field(default=None, gt=0, allow_inf_nan=False, description="depth of zero disparity, from the pupil")
    regular_grid_at_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="move views to an even grid, exactly for what lies at this depth; else they stay in place",
    )
    equalise: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE...", help_behavior_hint="")] = Field(
        default=(),
        description=(
            "make all views equally bright, as measured in these pictures or videos of any scene or a plain sheet; "
            "or an equalisation.json that this wrote before"
        ),
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if bool(self.frames) == (self.device is not None):
            raise ValueError("expected frames, videos, or --device NUMBER")
        names = [frame.stem for frame in self.frames]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"two frames are called {twice!r}, expected different names: each names its light field")
        return self


def taken_with(path: Path) -> str | None:
    """Identity of the layout that a frame or video was rendered with, by the manifest of its set; None without one."""
    for folder in path.resolve().parents[:2]:
        for name, schema in MANIFESTS.items():
            if (folder / name).is_file():
                try:
                    said = json.loads((folder / name).read_bytes())
                except ValueError:
                    continue  # of another program, which may call a file of its own so
                if isinstance(said, dict) and str(said.get("schema", "")).startswith(schema):
                    return str(said["layout_identity"])
    return None


def check_sizes(paths: Sequence[Path], layout: Layout, layout_path: Path) -> None:
    """Read pictures once, open videos: raise InputError for one that cannot be read or is not of the layout."""
    from mirrorcam.optics.base.files import is_picture, read_image
    from mirrorcam.optics.light_field.decoder import check_belongs
    from mirrorcam.optics.light_field.io.frames import Video

    expected = layout.camera.width_px, layout.camera.height_px
    for path in paths:
        if is_picture(path):
            height, width = read_image(path).shape[:2]
        else:
            video = Video(path)
            width, height = video.width_px, video.height_px
        if (width, height) != expected:
            wanted = f"expected {expected[0]}x{expected[1]} of {layout_path}'s camera"
            raise InputError(f"{path}: {width}x{height} px, {wanted}")
        identity = taken_with(path)
        if identity is not None:
            check_belongs(layout, identity, str(path))


def measured(paths: Sequence[Path], decoder: Decoder) -> Equalisation:
    """The equalisation measured in pictures and the first frames of videos."""
    from mirrorcam.optics.base.files import is_picture, read_image
    from mirrorcam.optics.light_field.equalisation import measure
    from mirrorcam.optics.light_field.io.frames import Frame, Video

    def light_fields() -> Iterator[LightField]:
        for path in paths:
            if is_picture(path):
                yield decoder.decode(read_image(path))
            else:
                whole = (item for item in Video(path).frames() if isinstance(item, Frame))
                yield from (decoder.decode(frame.pixels) for frame in islice(whole, MEASURED_FRAMES))

    return measure(light_fields())


def decode_frames(frames: Sequence[Path], layout_path: Path, out: Path, advance: Advance) -> None:
    """Decode pictures into `out`; every one is read once before anything is written, so that a bad one stops it all.

    Raises InputError for a frame that cannot be read or is not of the layout's camera.
    """
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.optics.light_field.decoder import Decoder

    layout = Layout.load(layout_path)
    check_sizes(frames, layout, layout_path)
    decode_pictures(frames, Decoder(layout), out, advance)


def decode_pictures(frames: Sequence[Path], decoder: Decoder, out: Path, advance: Advance) -> None:
    """Decode pictures that are known to be good into `out`."""
    from mirrorcam.optics.base.files import read_image, write_image
    from mirrorcam.optics.light_field.io.npz import save_npz
    from mirrorcam.optics.light_field.io.tiles import tiles

    for done, frame in enumerate(frames, start=1):
        light_field = decoder.decode(read_image(frame))
        save_npz(out / f"{frame.stem}.npz", light_field)
        write_image(out / f"{frame.stem}_views.png", tiles(light_field))
        advance(done, len(frames))


def spans(numbers: Sequence[int]) -> str:
    """Numbers in order as people write them: 3, 7 to 12."""
    runs = [[number for _, number in run] for _, run in groupby(enumerate(numbers), key=lambda each: each[1] - each[0])]
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)


def say_what_was_lost(name: str, recording: Recording, expected: int | None) -> None:
    """Name the frames that could not be used, and tell of a file that ends before it should."""
    entries = recording.entries
    seen = len(entries.numbers) + len(entries.lost)
    for reason in dict.fromkeys(entries.lost.values()):
        numbers = sorted(number for number, why in entries.lost.items() if why == reason)
        say("decode", f"{name}: skipped {len(numbers)} of {seen} frames, each {reason}: {spans(numbers)}")
    if expected is not None and seen < expected:
        say("decode", f"{name}: ends after {seen} of {expected} frames; the file is cut off")


def sink_of(format_name: Literal["zarr", "hci", "stanford"]) -> tuple[Sink, str]:
    """How to write a stream, and what its name ends in."""
    from mirrorcam.optics.light_field.io.formats.hci import write_hci
    from mirrorcam.optics.light_field.io.formats.stanford import write_stanford
    from mirrorcam.optics.light_field.io.recording import Folders
    from mirrorcam.optics.light_field.io.zarr_store import ZarrSink

    if format_name == "zarr":
        return ZarrSink(), ".zarr"
    return Folders(write_hci if format_name == "hci" else write_stanford), ""


def decode_stream(
    source: Video | Device, name: str, said: dict[str, Any], decoder: Decoder, options: DecodeOptions
) -> None:
    """Decode a video or a camera's stream into `options.out`, going on where an earlier run was cut off.

    Raises InputError for a stream without a frame that can be used, and where nothing can be written.
    """
    from mirrorcam.optics.base.files import write_image
    from mirrorcam.optics.light_field.io.frames import Video
    from mirrorcam.optics.light_field.io.recording import Recording, about
    from mirrorcam.optics.light_field.io.stream import record
    from mirrorcam.optics.light_field.io.tiles import tiles

    sink, suffix = sink_of(options.to)
    path, picture = options.out / f"{name}{suffix}", options.out / f"{name}_views.png"
    gain = None if decoder.equalisation is None else decoder.equalisation.gain.tolist()
    settings = {"regular_grid_at_mm": options.regular_grid_at_mm, "limit": options.limit, "equalisation": gain}
    recording = Recording(path, about(decoder.views, said, **settings), sink)
    if recording.complete:
        say("decode", f"{path} is there already, of the same frames")
        return
    if recording.entries.last >= 0:
        say("decode", f"{name}: going on after frame {recording.entries.last}")
    count = source.count if isinstance(source, Video) else None
    expected = options.limit if count is None or (options.limit or count) < count else count

    try:
        with long_work("decode", name, "frames") as advance:

            def on_frame(done: int, light_field: LightField | None) -> None:
                if light_field is not None and not picture.exists():
                    write_image(picture, tiles(light_field))
                advance(done, max(done, expected or 0))

            record(decoder, source, recording, on_frame=on_frame, limit=options.limit)
    except KeyboardInterrupt:
        if isinstance(source, Video):
            recording.close()
            say("decode", f"{count_text(len(recording.entries.numbers), 'frame')} kept, the same command goes on")
        else:
            recording.finish()
            say("decode", f"{path} written: {count_text(len(recording.entries.numbers), 'frame')}")
        raise
    recording.finish()
    say_what_was_lost(name, recording, expected)
    say("decode", f"{path} written: {count_text(len(recording.entries.numbers), 'frame')}; the first in {picture}")


def run(options: DecodeOptions) -> int:
    """Decode the frames."""
    from mirrorcam.optics.base.files import is_picture
    from mirrorcam.optics.geometry.layout import Layout
    from mirrorcam.optics.light_field.decoder import Decoder
    from mirrorcam.optics.light_field.equalisation import Equalisation
    from mirrorcam.optics.light_field.io.frames import Device, Video

    layout = Layout.load(options.layout)
    pictures = [path for path in options.frames if is_picture(path)]
    videos = [path for path in options.frames if not is_picture(path)]
    check_sizes(options.frames, layout, options.layout)
    factors = options.equalise[0] if [path.suffix for path in options.equalise] == [".json"] else None
    if factors is None:
        check_sizes(options.equalise, layout, options.layout)
    decoder = Decoder(
        layout,
        field=options.field,
        width_px=options.width_px,
        reference_depth_mm=options.reference_depth_mm,
        regular_grid_at_mm=options.regular_grid_at_mm,
    )
    if options.equalise:
        decoder = decoder.equalised(Equalisation.load(factors) if factors else measured(options.equalise, decoder))
    if layout.kind == "nominal":
        say("decode", f"{options.layout} is a design, not calibrated: views are where it wants them to be")
    if pictures:
        with long_work("decode", count_text(len(pictures), "frame"), "frames") as advance:
            decode_pictures(pictures, decoder, options.out, advance)
        say("decode", f"light fields (.npz) and tiled views (_views.png) written to {options.out}")
    if decoder.equalisation is not None and factors is None:
        decoder.equalisation.save(options.out / EQUALISATION)
        say("decode", f"factors of the views' brightness written to {options.out / EQUALISATION}")
    for path in videos:
        video = Video(path)
        said = {"file": path.name, "sha256": video.sha256(), "rate_hz": video.rate_hz}
        decode_stream(video, path.stem, said, decoder, options)
    if options.device is not None:
        device = Device(options.device, layout.camera.width_px, layout.camera.height_px)
        said = {"device": options.device, "started": datetime.now(UTC).isoformat()}
        decode_stream(device, f"device{options.device}", said, decoder, options)
    return 0
