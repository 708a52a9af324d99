"""Write an sdist anew so that the same files give the same bytes: `python .ci/settle_sdist.py SDIST.tar.gz`.

setuptools takes times and owners from the disk. Here files are sorted by name, owned by nobody, readable by all,
and from the second that SOURCE_DATE_EPOCH says.
"""

import gzip
import io
import os
import sys
import tarfile
from pathlib import Path


def settled(sdist: bytes, time_s: int) -> bytes:
    """The same archive with its members in order, and nothing in it of the machine and the hour of the build."""
    packed = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(sdist)) as source,
        gzip.GzipFile(fileobj=packed, mode="wb", filename="", mtime=time_s) as stream,
        tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as target,
    ):
        for member in sorted(source.getmembers(), key=lambda each: each.name):
            if not (member.isfile() or member.isdir()):
                sys.exit(f"{member.name}: neither a file nor a folder")
            clean = tarfile.TarInfo(member.name)
            clean.size, clean.type, clean.mtime = member.size, member.type, time_s
            clean.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
            target.addfile(clean, source.extractfile(member) if member.isfile() else None)
    return packed.getvalue()


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_bytes(settled(path.read_bytes(), int(os.environ["SOURCE_DATE_EPOCH"])))
