"""Memory of a large set: `python -m benchmarks.render_memory [--frames N] [--scale S] [--maps] [--json F]`.

Renders N frames (1,000) of the default camera by formula with all cores, its sensor scaled by S (1/4), into a temporary
folder, and prints the resident memory of the parent and of its largest worker as frames are finished. Exits with 1
where either grows by more than GROWTH_MIB from the 100th frame to the last. Needs Linux, whose /proc tells.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.records import add_json_option, write_record
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.simulation.rendering import in_workers

DEFAULT_LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
BOARD = Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=18.0)
SETTLED, STEP = 100, 50  # frames after which everything has been allocated, and from look to look
GROWTH_MIB = 16.0


def resident_mib(pid: int) -> float:
    """Resident memory of a process, MiB; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def measure(request: SetRequest, out: Path, workers: int) -> dict[int, tuple[float, float]]:
    """Resident memory, MiB, of the parent and of its largest worker after a number of frames."""
    found: dict[int, tuple[float, float]] = {}

    def look(done: int, total: int) -> None:
        if done % STEP == 0 and done >= SETTLED:
            pids = [process.pid for process in multiprocessing.active_children() if process.pid is not None]
            found[done] = resident_mib(os.getpid()), max(map(resident_mib, pids), default=0.0)

    render_set(request, out, run=in_workers(workers), progress=look)
    return found


def main(frames: int, scale: float, maps: bool, json: Path | None = None) -> int:
    layout = Layout.load(DEFAULT_LAYOUT)
    request = SetRequest(
        layout=layout.replaced(camera=layout.camera.binned(scale)),
        target=BOARD,
        frames=frames,
        base_frames=0,
        settings=RenderSettings(renderer="fast", maps=maps),
    )
    with TemporaryDirectory() as folder:
        found = measure(request, Path(folder) / "set", cores())
    figures: dict[str, float] = {}
    for done, (parent, worker) in found.items():
        print(f"{done:5} frames  parent {parent:6.1f} MiB  worker {worker:6.1f} MiB")
        figures |= {f"parent_after_{done}_mib": round(parent, 1)}
        figures |= {f"worker_after_{done}_mib": round(worker, 1)} if worker > 0.0 else {}
    write_record(json, "render_memory", figures)
    # The last look may find the workers gone.
    looks = [look for look in found.values() if look[1] > 0.0]
    growth = [last - first for first, last in zip(looks[0], looks[-1], strict=True)]
    print(f"growth: parent {growth[0]:.1f} MiB, worker {growth[1]:.1f} MiB (limit {GROWTH_MIB:g})")
    return 0 if max(growth) <= GROWTH_MIB else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--scale", type=float, default=0.25)
    parser.add_argument("--maps", action="store_true")
    add_json_option(parser)
    options = parser.parse_args()
    sys.exit(main(options.frames, options.scale, options.maps, options.json))
