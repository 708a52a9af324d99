"""What an import may load. Which module may import which is in pyproject.toml, for `lint-imports`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
# The four packages and the folders that hold them.
FOLDERS = {
    "mirrorcam.optics": ROOT / "optics",
    "mirrorcam.cad": ROOT / "cad",
    "mirrorcam.render_scenes": ROOT / "render_scenes",
    "mirrorcam": ROOT / "src" / "mirrorcam",
}
LATE_FOR_THE_COMMAND = (
    *("casadi", "build123d", "OCP", "mitsuba", "drjit", "matplotlib", "scipy", "cv2", "shapely"),
    *("dask", "distributed", "pyarrow", "OpenEXR", "av", "zarr", "numcodecs", "PIL", "h5py", "jinja2"),
    *("rosbags", "rerun", "numba", "starlette", "uvicorn", "fsspec"),
)
KERNELS = {"build123d", "OCP", "manifold3d", "trimesh", "ezdxf", "lib3mf"}


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after a statement."""
    code = f"{statement}\nimport sys\nprint('\\n'.join(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return {name.partition(".")[0] for name in done.stdout.split()}


def test_the_command_starts_without_its_heavy_libraries() -> None:
    loaded = loaded_by("import mirrorcam.cli")
    assert "mirrorcam" in loaded
    assert loaded.isdisjoint(LATE_FOR_THE_COMMAND)


def test_plans_of_parts_are_numbers_without_a_cad_kernel() -> None:
    plans = [f"mirrorcam.cad.plan.{path.stem}" for path in sorted((ROOT / "cad" / "plan").glob("[!_]*.py"))]
    assert len(plans) > 8
    assert loaded_by(f"import {', '.join(plans)}").isdisjoint(KERNELS)
