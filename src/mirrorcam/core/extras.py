"""Optional parts of the installation, checked before their work begins."""

from __future__ import annotations

from importlib.util import find_spec

from mirrorcam.core.errors import InputError

MODULES = {
    "cad": ("build123d", "trimesh", "manifold3d", "ezdxf", "lib3mf", "markdown_it", "tomli_w"),
    "render": ("mitsuba", "drjit", "OpenEXR"),
    "fe": ("skfem",),
    "cluster": ("dask", "distributed"),
    "remote": ("fsspec",),
    "parquet": ("pyarrow",),
    "robot": ("rosbags",),
    "view": ("rerun",),
    "studio": ("starlette", "uvicorn", "tomli_w"),
}


def missing_modules(extra: str) -> list[str]:
    """Return the modules of an extra that are not installed."""
    return [module for module in MODULES[extra] if find_spec(module) is None]


def require(*extras: str) -> None:
    """Raise InputError if modules of extras are missing; the message states the command that installs them."""
    missing = {extra: missing_modules(extra) for extra in extras}
    lacking = [extra for extra, modules in missing.items() if modules]
    if lacking:
        modules = ", ".join(module for extra in lacking for module in missing[extra])
        install = f'pip install "mirrorcam[{",".join(lacking)}]"'
        raise InputError(f"{modules} not installed, needed for this command: {install}")
