"""The folder that a device is built in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mirrorcam.cad.plan.device_names import files_of
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.disk.output_folder import output_folder


@contextmanager
def device_folder(folder: Path, hardware: Hardware, *, elastic: bool, force: bool) -> Iterator[Path]:
    """Yield an empty folder for `build_parts`, whose files replace an earlier call's when the block ends.

    They are also put in their places where the block ends with an error after the checks are written. Raises
    InputError, before the block, without `force` where a file would be replaced that no such call wrote, or that was
    changed since.
    """
    with output_folder(folder, "cad", force=force) as output:
        output.refuse_changed()
        output.refuse_others(*files_of(hardware, elastic=elastic))
        with output.staged(result="checks.json") as staged:
            yield staged
