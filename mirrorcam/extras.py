"""Optional parts of the installation, asked for before their work begins."""

from __future__ import annotations

from importlib.util import find_spec

from optics.values import InputError

MODULES = {"cad": ("build123d", "trimesh", "manifold3d", "ezdxf"), "render": ("mitsuba", "drjit")}


def require(extra: str) -> None:
    """Raise InputError, naming the command that installs it, where a module of an extra is missing."""
    missing = [module for module in MODULES[extra] if find_spec(module) is None]
    if missing:
        raise InputError(
            f'{", ".join(missing)} not installed, needed for this command: pip install "mirrorcam[{extra}]"'
        )
