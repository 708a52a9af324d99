"""The folder of a device."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mirrorcam.cad.plan.device_names import files_of
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.disk.output_folder import output_folder


@contextmanager
def device_folder(folder: Path, hardware: Hardware, *, elastic: bool, force: bool) -> Iterator[Path]:
    """Yield an empty folder for `build_parts`; at the end of the block, its files replace those of an earlier call.

    They are also moved into place if the block raises after the checks are written. Without `force`, raises InputError
    before the block if a file to replace was not written by such a call, or was changed since.
    """
    with output_folder(folder, "cad", force=force) as output:
        output.refuse_changed()
        output.refuse_others(*files_of(hardware, elastic=elastic))
        with output.staged(result="checks.json") as staged:
            yield staged
