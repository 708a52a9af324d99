"""Damaged and hostile light fields of every format: read, with each frame of a recording."""

from __future__ import annotations

import json
import struct
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import h5py
import numpy as np

from benchmarks.robustness.damage import damaged_bytes, damaged_value
from benchmarks.robustness.guard import Category, message_fault
from benchmarks.robustness.hostile_light_fields import HOSTILE, SECRET, plant
from mirrorcam.core.errors import InputError
from mirrorcam.core.video.frames import Frame
from mirrorcam.optics.camera_files.read.colmap import read_model
from mirrorcam.optics.light_field.io.formats.lftoolbox import intrinsics
from mirrorcam.optics.light_field.io.formats.registry import formats, open_light_fields, write_light_field
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed
from mirrorcam.optics.light_field.io.recording import Recording, about
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink
from mirrorcam.optics.light_field.light_field import LightField, Views

SUBJECTS = tuple(HOSTILE)
FRAMES = 3
# Files in which a checksum finds damage to samples; Blosc, .npy and HDF5 without filters have none.
CHECKED = {".png", ".npz", ".mat"}
_ASSUMED = Assumed(rows=3, cols=3, step_mm=10.0, focal_px=20.0, reference_depth_mm=400.0)


def light_field() -> LightField:
    """Return a light field of noise, with some pixels without a sample."""
    positions_mm = np.stack(np.meshgrid(np.arange(3.0), np.arange(3.0)), axis=-1) * 10.0
    views, random = Views.parallel(positions_mm, (24, 18), 20.0, 400.0), np.random.default_rng(1)
    weights = random.integers(0, 2, (3, 3, 18, 24)).astype(np.float32)
    weights[:, :, :, 12:] = 1.0
    samples = random.integers(0, 200, (3, 3, 18, 24, 3), dtype=np.uint8)
    samples[weights == 0] = 0
    return LightField.of(views, samples, weights)


def write(path: Path, subject: str) -> None:
    """Write the light field: a format, `hdf5` for MATLAB 7.3, `partial` for a recording that was cut off."""
    if subject == "hdf5":
        lf = np.concatenate([light_field().samples, (light_field().weights[..., None] * 255).astype(np.uint8)], axis=-1)
        with h5py.File(path, "w", userblock_size=512) as file:
            file.create_dataset("LF", data=lf.T, compression="gzip", shuffle=True)
            file["RectOptions/RectCamIntrinsicsH"] = intrinsics(light_field()).T
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(128))
    elif subject in ("zarr", "partial"):
        complete = path.with_name(path.name.removesuffix(".partial"))
        recording = Recording(complete, about(light_field(), {"file": "noise"}), ZarrSink())
        for number in range(FRAMES):
            recording.add(Frame(number, 0.1 * number, np.empty((0, 0, 3), np.uint8)), light_field())
        if subject == "zarr":
            recording.finish()
        recording.close()
    elif subject == "colmap_bin":
        write_light_field(path, light_field(), "colmap")
        (path / "views.json").unlink()
        for text, content in colmap_binaries(path / "sparse").items():
            (path / "sparse" / text).unlink()
            (path / "sparse" / text).with_suffix(".bin").write_bytes(content)
    else:
        write_light_field(path, light_field(), subject)


def colmap_binaries(model: Path) -> dict[str, bytes]:
    """Return `cameras` and `images` of a text model in COLMAP's binary layout, by the name of the text."""
    read = read_model(model)
    cameras, images = struct.pack("<Q", len(read.cameras)), struct.pack("<Q", len(read.images))
    for number, camera in read.cameras.items():
        cameras += struct.pack("<IiQQ4d", number, 1, camera.width_px, camera.height_px, *camera.parameters)
    for number, image in enumerate(read.images, start=1):
        images += struct.pack("<I7dI", number, *image.pose, image.camera_id) + image.name.encode() + b"\0" + bytes(8)
    return {"cameras.txt": cameras, "images.txt": images}


def _suffix(subject: str) -> str:
    return {"hdf5": ".mat", "partial": ".zarr.partial", "colmap_bin": "_colmap"}.get(subject) or formats()[
        subject
    ].ending


@cache
def valid_files(subject: str) -> Mapping[str, bytes]:
    """Return the files of the light field, by path."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / f"a{_suffix(subject)}", subject)
        files = sorted(file for file in Path(folder).rglob("*") if file.is_file())
        return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def attempt(seed: int, folder: Path) -> str:
    """Read a damaged or hostile light field, of formats in turn."""
    random, subject = np.random.default_rng(seed), SUBJECTS[seed % len(SUBJECTS)]
    path, secrets = folder / "in" / f"a{_suffix(subject)}", folder / "secrets"
    for name, content in valid_files(subject).items():
        (folder / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "in" / name).write_bytes(content)
    secrets.mkdir()
    plant(secrets)
    file = _damage(path, subject, secrets, random)
    assumed = _ASSUMED if random.random() < 0.5 else NOTHING
    try:
        frames = list(open_light_fields(path, assumed=assumed).frames)
    except InputError as error:
        where = str(path.parent / path.stem.removesuffix(".zarr")) in str(error)
        return message_fault(str(error).replace(str(folder), "")) or ("" if where else f"names no file: {error}")
    finally:
        executed = (secrets / "executed").exists()
    return "unpickled" if executed else _fault(frames, file)


def _damage(path: Path, subject: str, secrets: Path, random: np.random.Generator) -> str:
    """Damage the light field; return the suffix of the file whose bytes were damaged, or ""."""
    if random.random() < 0.35:
        changes = HOSTILE[subject]
        changes[int(random.integers(len(changes)))](path, secrets, random)
        return ""
    names = sorted(valid_files(subject))
    texts = [name for name in names if name.endswith(".json")]
    if texts and random.random() < 0.4:
        file = path.parent / texts[int(random.integers(len(texts)))]
        value = damaged_value(json.loads(file.read_bytes()), random)
        file.write_text(json.dumps(value), encoding="utf-8")
        return ""
    file = path.parent / names[int(random.integers(len(names)))]
    file.write_bytes(damaged_bytes(file.read_bytes(), random))
    return file.suffix


def _fault(frames: list[LightField], damaged: str) -> str:
    """Return what is wrong with light fields that were read, or ""."""
    for frame in frames:
        if SECRET[:48] in frame.samples.tobytes() or SECRET[:48] in frame.weights.tobytes():
            return "contains data from outside"
        if not np.isfinite(frame.matrices).all() or not frame.weights.any():
            return "invalid views"
        if damaged in CHECKED and not _is_same(frame):
            return f"damage to {damaged} not noticed"
    return ""


def _is_same(frame: LightField) -> bool:
    expected = light_field()
    return np.array_equal(frame.samples, expected.samples) and np.array_equal(frame.valid, expected.valid)


CATEGORY = Category("light fields", 1_000, attempt)
