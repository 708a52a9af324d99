"""Hostile light fields: impossible sizes, names and links that lead outside, objects to be unpickled."""

from __future__ import annotations

import io
import json
import pickle
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import h5py
import numpy as np

SECRET = b"\xc9\x0d\x4d" * 4096
"""Content of files outside the light field, raw and as pixels of pictures: a colour that none of its views has."""
_HUGE = (10**5, 10**5, 10**5, 10**5, 3)

Change = Callable[[Path, Path, np.random.Generator], None]
"""Changes the files of a valid light field at the first path; the second is a folder of files that must not be read."""


def _npy(shape: tuple[int, ...], content: bytes = b"", kind: str = "|u1") -> bytes:
    """Return an .npy file with a header and any content."""
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    text = header.ljust(-(-(len(header) + 11) // 64) * 64 - 11).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


_BOMB_HEADER = _npy((1, 9, 2500, 5000), kind="<f4")


@cache
def _deflated(begin: bytes, megabytes: int) -> bytes:
    """Return compressed (deflate) `begin` and zeros."""
    compress = zlib.compressobj()
    content = compress.compress(begin) + b"".join(compress.compress(bytes(1 << 20)) for _ in range(megabytes))
    return content + compress.flush()


class _Executes:
    """An object that creates a file when unpickled."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self._path,)


def _pickled(secrets: Path) -> bytes:
    return _npy((1,), pickle.dumps([_Executes(secrets / "executed")]), "|O")


def _replace_member(path: Path, name: str, content: bytes) -> None:
    """Replace a member of an .npz file."""
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, original in members.items():
            archive.writestr(member, content if member == name else original)


def _npz_huge(path: Path, secrets: Path, random: np.random.Generator) -> None:
    _replace_member(path, "samples.npy", _npy(_HUGE))


def _npz_pickled(path: Path, secrets: Path, random: np.random.Generator) -> None:
    _replace_member(path, random.choice(["samples.npy", "focal_px.npy", "layout_identity.npy"]), _pickled(secrets))


@cache
def _with_bomb(valid: bytes) -> bytes:
    """Return an .npz file whose weights are 450 MB of zeros."""
    content = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(valid)) as source, zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in source.namelist():
            with archive.open(name, "w") as member:
                bomb = (_BOMB_HEADER, *[bytes(1_000_000)] * 450)
                for piece in bomb if name == "weights.npy" else (source.read(name),):
                    member.write(piece)
    return content.getvalue()


def _npz_bomb(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Make a member too large; in half of the cases, its stated size is 1000 bytes."""
    raw = _with_bomb(path.read_bytes())
    if random.random() < 0.5:
        raw = raw.replace(struct.pack("<I", len(_BOMB_HEADER) + 450_000_000), struct.pack("<I", 1000))
    path.write_bytes(raw)


def _npy_huge(path: Path, secrets: Path, random: np.random.Generator) -> None:
    array = random.choice([*map(str, path.glob("*.npy"))])
    Path(array).write_bytes(_npy(_HUGE if "weights" not in array else _HUGE[:4], b"", "<f4"))


def _npy_pickled(path: Path, secrets: Path, random: np.random.Generator) -> None:
    Path(random.choice([*map(str, path.glob("*.npy"))])).write_bytes(_pickled(secrets))


def _picture_huge(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Write a PNG whose header states 100,000 x 100,000 px, or 9,000 x 9,000 px without data."""
    pictures = [path] if path.is_file() else sorted(path.rglob("*.png"))
    side = int(random.choice([100_000, 9_000]))
    header = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    body = b"IDAT" + zlib.compress(bytes(1 << 20))
    raw = b"\x89PNG\r\n\x1a\n"
    for chunk in (header, body, b"IEND"):
        raw += struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    for picture in pictures if random.random() < 0.5 else pictures[:1]:
        picture.write_bytes(raw)


def _mat5_huge(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Write a variable LF, an array of numbers or cells, with impossible dimensions."""
    dimensions = struct.pack("<II8i", 5, 20, 60000, 60000, 60000, 60000, 3, 0, 0, 0)[:32]
    kind = int(random.choice([1, 6, 9]))
    flags, name = struct.pack("<IIII", 6, 8, kind, 0), struct.pack("<HH4s", 1, 2, b"LF\0\0")
    matrix = flags + dimensions + name + struct.pack("<II", 2, int(random.choice([8, 0xFFFFFFF8]))) + bytes(8)
    header = path.read_bytes()[:128]
    path.write_bytes(header + struct.pack("<II", 14, len(matrix)) + matrix)


def _mat5_bomb(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Write a compressed variable of 450 MB of zeros, whatever size it states."""
    content = _deflated(struct.pack("<II", 14, int(random.choice([450_000_000, 1000]))), 600)
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(content)) + content)


def _hdf5_links(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Make LF, or the group of H, a link to a different file or within this one."""
    with h5py.File(path, "a") as file:
        target = random.choice(["LF", "RectOptions"])
        file.move(target, "elsewhere")
        kind = random.choice(["external", "soft", "loop"])
        if kind == "external":
            file[target] = h5py.ExternalLink(str(secrets / "secret.h5"), "LF")
        else:
            file[target] = h5py.SoftLink("/elsewhere" if kind == "soft" else f"/{target}")


def _hdf5_storage(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Store LF in a different file, as raw bytes or by a virtual data set."""
    with h5py.File(path, "a") as file:
        shape = file["LF"].shape
        del file["LF"]
        if random.random() < 0.5:
            size = int(np.prod(shape))
            file.create_dataset("LF", shape, "u1", external=[(str(secrets / "secret.bin"), 0, size)])
        else:
            layout = h5py.VirtualLayout(shape=shape, dtype="u1")
            layout[0, 0, 0, 0] = h5py.VirtualSource(str(secrets / "secret.h5"), "LF", shape=(4096,))[: shape[-1]]
            file.create_virtual_dataset("LF", layout)


def _hdf5_sizes(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Make LF an array without data, of impossible size, of text, or a compression bomb."""
    with h5py.File(path, "a") as file:
        lf = file["LF"][()]
        del file["LF"]
        kind = random.choice(["huge", "missing", "lzf", "text", "bomb"])
        if kind == "huge":
            file.create_dataset("LF", _HUGE, "u1", chunks=(1, 1, 100, 100, 3))
        elif kind == "missing":
            file.create_dataset("LF", lf.shape, "u1", chunks=lf.shape)
        elif kind == "lzf":
            file.create_dataset("LF", data=lf, compression="lzf")
        elif kind == "text":
            file.create_dataset("LF", lf.shape, h5py.string_dtype())
        else:
            dataset = file.create_dataset("LF", lf.shape, "u1", chunks=lf.shape, compression="gzip")
            dataset.id.write_direct_chunk((0,) * lf.ndim, _deflated(b"", 200))


def _zarr_metadata(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Give an array unknown codecs, types, keys or chunks, or an impossible shape."""
    file = path / str(random.choice(["samples", "weights", "number", "time_s"])) / "zarr.json"
    if not file.exists():
        file = path / "samples" / "zarr.json"
    metadata = json.loads(file.read_text(encoding="utf-8"))
    huge = [10**9] * len(metadata["shape"])
    changes: list[dict[str, Any]] = [
        {"codecs": [{"name": "bytes"}, {"name": "numcodecs.pickle", "configuration": {}}]},
        {"codecs": [{"name": "bytes"}, {"name": "gzip", "configuration": {"level": 1}}]},
        {"codecs": [{"name": "vlen-utf8"}]},
        {"codecs": [{"name": "sharding_indexed", "configuration": {"chunk_shape": [1]}}]},
        {"shape": huge},
        {"shape": huge, "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": huge}}},
        {"shape": [100_000, *metadata["shape"][1:]]},
        {"shape": [3 * length for length in metadata["shape"]]},
        {"data_type": "string"},
        {"data_type": "float32" if metadata["data_type"] != "float32" else "uint8"},
        {"data_type": {"name": "numpy.object", "configuration": {}}},
        {"chunk_key_encoding": {"name": "v2", "configuration": {"separator": "../"}}},
        {"fill_value": 7},
        {"zarr_format": 2},
        {"storage_transformers": [{"name": "other"}]},
    ]
    file.write_text(json.dumps(metadata | changes[int(random.integers(len(changes)))]), encoding="utf-8")


def _zarr_files(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Remove an array, link chunks to outside files, or make a chunk state or hold a wrong size."""
    chunks = sorted(file for file in path.rglob("*") if file.is_file() and "c" in file.relative_to(path).parts)
    chunk, kind = chunks[int(random.integers(len(chunks)))], random.choice(["array", "link", "size", "zstd", "group"])
    if kind == "array":
        (path / str(random.choice(["samples", "weights"])) / "zarr.json").unlink()
    elif kind == "link":
        file = path / "samples" / "zarr.json"
        metadata = json.loads(file.read_text(encoding="utf-8")) | {"codecs": [{"name": "bytes"}]}
        file.write_text(json.dumps(metadata), encoding="utf-8")
        for sample_chunk in chunks:
            if "samples" in sample_chunk.parts:
                sample_chunk.unlink()
                sample_chunk.symlink_to(secrets / "secret.bin")
    elif kind == "size":
        raw = bytearray(chunk.read_bytes())
        raw[4:8] = struct.pack("<I", 0x7FFFFFFF)
        chunk.write_bytes(bytes(raw))
    elif kind == "zstd":
        from numcodecs import Zstd

        chunk.write_bytes(chunk.read_bytes() + Zstd().encode(bytes(1 << 26)) * 20)
    else:
        (path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group"}', encoding="utf-8")


def _mcap_chunk(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Write a chunk that holds far more than it states, in one or more frames of Zstandard, or states too much."""
    from numcodecs import Zstd

    raw, kind = path.read_bytes(), random.choice(["frame", "frames", "lz4", "huge"])
    frame = Zstd().encode(bytes(1 << 26))
    content = frame * 20 if kind == "frames" else frame
    name = b"lz4" if kind == "lz4" else b"zstd"
    stated = {"frames": 1 << 26, "huge": 10**15}.get(str(kind), 1000)
    body = struct.pack("<QQQII", 0, 0, stated, 0, len(name)) + name + struct.pack("<Q", len(content)) + content
    (header,) = struct.unpack_from("<Q", raw, 9)
    chunk = struct.pack("<BQ", 6, len(body)) + body
    path.write_bytes(raw[: 17 + header] + chunk + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + raw[:8])


def _names_lead_out(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """Let names of pictures in a model or data set lead to files outside its folder."""
    prefix = "../" * int(random.integers(1, 5)) + "secrets" if random.random() < 0.7 else str(secrets)
    for file in (path / "transforms.json", path / "sparse" / "images.txt"):
        if file.exists():
            text = file.read_text(encoding="utf-8")
            keys = "file_path|mask_path" if random.random() < 0.5 else str(random.choice(["file_path", "mask_path"]))
            text = re.sub(rf'("(?:{keys})": ")[^"]*(view_\d+_\d+)', rf"\1{prefix}/\2", text)
            text = re.sub(r"^(\d+ .* )(view_\d+_\d+)/0000.png$", rf"\1\2/{prefix}/\2.png", text, flags=re.MULTILINE)
            file.write_text(text, encoding="utf-8")


def _colmap_counts(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """State far more cameras, pictures or points than the file holds, or a picture outside the folder."""
    file = path / "sparse" / str(random.choice(["cameras.bin", "images.bin"]))
    raw = file.read_bytes()
    huge = struct.pack("<Q", int(random.choice([10**6, 2**62])))
    # An image's name, which ends with a zero, is followed by the number of its points.
    end = raw.index(b"0000.png\0") + 9 if file.name == "images.bin" else 8
    name = raw.replace(b"view_00_00/0000.png", b"../../../secret.png")
    changed = [huge + raw[8:], raw[:end] + huge + raw[end + 8 :], name if name != raw else huge + raw[8:]]
    file.write_bytes(changed[int(random.integers(3))])


def _many_views(path: Path, secrets: Path, random: np.random.Generator) -> None:
    """State more views, or larger ones, than exist."""
    file = path / "parameters.cfg"
    key = str(random.choice(["num_cams_x", "num_cams_y", "image_resolution_x_px", "image_resolution_y_px"]))
    number = str(random.choice(["1000000", "1e308", "900", "100000", "3.5"]))
    text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {number}", file.read_text(encoding="utf-8"))
    file.write_text(text if random.random() < 0.5 else text.partition("[mirrorcam]")[0], encoding="utf-8")


HOSTILE: dict[str, tuple[Change, ...]] = {
    "npz": (_npz_huge, _npz_pickled, _npz_bomb),
    "plenpy": (_npy_huge, _npy_pickled),
    "plenopticam": (_npy_huge, _npy_pickled, _picture_huge),
    "lftoolbox": (_mat5_huge, _mat5_bomb),
    "hdf5": (_hdf5_links, _hdf5_storage, _hdf5_sizes),
    "zarr": (_zarr_metadata, _zarr_files),
    "partial": (_zarr_metadata, _zarr_files),
    **({"mcap": (_mcap_chunk,)} if find_spec("rosbags") else {}),
    "nerfstudio": (_names_lead_out, _picture_huge),
    "colmap": (_names_lead_out, _picture_huge),
    "colmap_bin": (_colmap_counts, _picture_huge),
    "hci": (_many_views, _picture_huge),
    "stanford": (_picture_huge,),
    "eslf": (_picture_huge,),
    "tiles": (_picture_huge,),
}
"""Changes to a light field of each format; bags need the extra robot."""


def plant(secrets: Path) -> None:
    """Write files that no light field may read: raw, as HDF5, and as the pictures to which names could lead."""
    from mirrorcam.core.images.pictures import encoded_image

    (secrets / "secret.bin").write_bytes(SECRET)
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file["LF"] = np.frombuffer(SECRET[:4096], np.uint8)
    (secrets / "secret.h5").write_bytes(content.getvalue())
    picture = encoded_image(np.frombuffer(SECRET, np.uint8)[: 18 * 24 * 3].reshape(18, 24, 3), ".png")
    for row in range(3):
        for col in range(3):
            (secrets / f"view_{row:02d}_{col:02d}.png").write_bytes(picture)
