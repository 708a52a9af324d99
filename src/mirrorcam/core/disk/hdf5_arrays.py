"""Numeric arrays of HDF5 files, without external storage."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.array_files import as_input_error, check_bytes
from mirrorcam.core.disk.files import stored_bytes
from mirrorcam.core.errors import InputError

if TYPE_CHECKING:
    import h5py

FILTERS = {1: "deflate", 2: "shuffle", 3: "fletcher32"}
"""Accepted filters by their HDF5 numbers; others may be plug-ins, which HDF5 would load."""
_DEFLATE = 1
_PIECE_BYTES = 1 << 20


def read_hdf5(path: Path, dataset_paths: Mapping[str, str], expected: str) -> dict[str, NDArray[Any]]:
    """Read arrays by name from paths such as `group/name`, without those that the file lacks.

    Raises
    ------
    InputError
        In one line for a file that is not `expected`, and for arrays behind links, in other files, with other filters,
        incomplete, or above the memory limit for a file of this size.
    """
    import h5py

    stored, arrays, total_bytes = stored_bytes(path), {}, 0
    with as_input_error(path, expected), h5py.File(path, "r") as file:
        for name, dataset_path in dataset_paths.items():
            dataset = _dataset(file, dataset_path, path)
            if dataset is not None:
                total_bytes += dataset.nbytes
                check_bytes(path, total_bytes, stored)
                _check_storage(dataset, path, stored)
                arrays[name] = np.asarray(dataset[()])
    return arrays


def _dataset(file: h5py.File, dataset_path: str, path: Path) -> h5py.Dataset | None:
    """Return the dataset at a path, or None; every link on the path must stay within the file."""
    import h5py

    node: Any = file
    for name in dataset_path.split("/"):
        link = node.get(name, getlink=True) if isinstance(node, h5py.Group) else None
        if link is None:
            return None
        if not isinstance(link, h5py.HardLink):
            raise InputError(f"{path}: {dataset_path} is a link, expected an array in the file itself")
        node = node[name]
    return node if isinstance(node, h5py.Dataset) else None


def _check_storage(dataset: h5py.Dataset, path: Path, stored: int) -> None:
    """Raise InputError unless a dataset is stored in the file, with accepted filters."""
    where = f"{path}: {dataset.name}"
    if dataset.external or dataset.is_virtual:
        raise InputError(f"{where} is stored in other files, expected an array in the file itself")
    if dataset.dtype.kind not in "uif":
        raise InputError(f"{where} holds {str(dataset.dtype)[:40]}, expected numbers")
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(number)[0] for number in range(properties.get_nfilters())]
    if unknown := set(filters) - FILTERS.keys():
        raise InputError(f"{where} has filter {min(unknown)}, expected none but {', '.join(FILTERS.values())}")
    if dataset.chunks is None:
        if dataset.id.get_storage_size() != dataset.nbytes:
            raise InputError(f"{where} is incomplete")
        return
    sizes = [-(-length // chunk) for length, chunk in zip(dataset.shape, dataset.chunks, strict=True)]
    if dataset.id.get_num_chunks() != math.prod(sizes):
        raise InputError(f"{where} is incomplete")
    chunk_bytes = math.prod(dataset.chunks) * dataset.dtype.itemsize
    check_bytes(path, chunk_bytes, stored)
    if _DEFLATE in filters:
        _check_inflated(dataset, chunk_bytes, path)


def _check_inflated(dataset: h5py.Dataset, chunk_bytes: int, path: Path) -> None:
    """Raise InputError for a chunk that inflates to more than its stated size: HDF5 would allocate all of it."""
    for number in range(dataset.id.get_num_chunks()):
        chunk = dataset.id.get_chunk_info(number)
        # Deflate expands a byte to at most 1032; filters may add four for a checksum.
        if 1032 * chunk.size <= chunk_bytes + (1 << 26):
            continue
        raw, total, inflate = dataset.id.read_direct_chunk(chunk.chunk_offset)[1], 0, zlib.decompressobj()
        while raw and not inflate.eof and total <= chunk_bytes + 4:
            total += len(inflate.decompress(raw, _PIECE_BYTES))
            raw = inflate.unconsumed_tail
        if total > chunk_bytes + 4:
            raise InputError(f"{path}: {dataset.name} has a chunk of more than the {chunk_bytes} bytes that it states")
