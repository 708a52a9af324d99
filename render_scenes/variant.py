"""Choice of Mitsuba's variant: CUDA where a GPU is available, otherwise LLVM, scalar as a last resort; it never aborts.

Dr.Jit loads a shared LLVM as soon as it is imported. Several versions (15 and 16 among them) end the whole process
with an LLVM ERROR when a kernel is compiled, and Dr.Jit loads whichever the distribution ships. Therefore a library is
used only if the `render` extra installed it or a child process has rendered with it, and no module of this folder
imports mitsuba or drjit before `use_variant` has pointed Dr.Jit at the library.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib.util
import logging
import os
import subprocess
import sys
from functools import cache
from importlib import metadata
from pathlib import Path

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.child_program import run_program

CUDA, LLVM, SCALAR = "cuda_ad_mono", "llvm_ad_mono", "scalar_rgb"
COLOUR_VARIANTS = {CUDA: "cuda_ad_rgb", LLVM: "llvm_ad_rgb", SCALAR: SCALAR}
PACKAGE = "karellen-llvm-core"
LIBRARY_VARIABLE = "DRJIT_LIBLLVM_PATH"
_LAST_ABORTING_LLVM = 16
_log = logging.getLogger(__name__)

# Float comparisons, a ray cast and a reduction: an unusable LLVM or driver fails to compile these.
_PROBE = """
import sys
import mitsuba as mi
mi.set_variant(sys.argv[1])
scene = mi.load_dict({"type": "scene", "shape": {"type": "rectangle"}, "integrator": {"type": "depth"}})
ray = mi.Ray3f(mi.Point3f(0.25, 0.25, mi.Float([3.0, 4.0])), mi.Vector3f(0.0, 0.0, -1.0))
import drjit as dr
distance = dr.minimum(scene.ray_intersect(ray).t, mi.Float(3.5))
sys.exit(0 if abs(dr.sum(distance)[0] - 6.5) < 1e-5 else 1)
"""


def packaged_library() -> Path | None:
    """Return the libLLVM that the `render` extra installed, by its full file name: short links may not exist yet."""
    try:
        files = metadata.distribution(PACKAGE).files or []
    except metadata.PackageNotFoundError:
        return None
    libraries = [Path(str(file.locate())) for file in files if file.name.startswith(("libLLVM.so.", "libLLVM.dylib"))]
    return next((path.resolve() for path in libraries if path.is_file()), None)


def can_load(library: Path) -> bool:
    """Return whether the dynamic loader accepts a library; preload the packaged C++ runtime if its links are missing.

    The package creates the link libc++.so.1 when Python first starts after the installation, too late for that process.
    A runtime loaded globally under its full name satisfies the loader, too.
    """
    try:
        ctypes.CDLL(str(library))
        return True
    except OSError:
        for runtime in ("libunwind.so.1.0", "libc++abi.so.1.0", "libc++.so.1.0"):
            for path in sorted(library.parent.glob(f"*/{runtime}")):
                try:
                    ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
                except OSError as error:
                    _log.debug("%s: %s", path, error)
    try:
        ctypes.CDLL(str(library))
        return True
    except OSError:
        return False


def can_render(variant: str, library: Path | None = None) -> bool:
    """Return whether a variant (and an LLVM library) can render, tested in a child process because it may abort."""
    environment = dict(os.environ)
    if library is not None:
        environment[LIBRARY_VARIABLE] = str(library)
    command = [sys.executable, "-c", _PROBE, variant]
    try:
        process = run_program(command, timeout_s=120, environment=environment)
    except subprocess.TimeoutExpired:
        return False
    return process.returncode == 0


def has_gpu() -> bool:
    """Return whether the CUDA driver is present and reports a device."""
    try:
        driver = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    except OSError:
        return False
    count = ctypes.c_int(0)
    return driver.cuInit(0) == 0 and driver.cuDeviceGetCount(ctypes.byref(count)) == 0 and count.value > 0


def _system_libraries() -> list[Path]:
    """Return the LLVM libraries of the system, newest first."""
    versions = range(24, 16, -1)
    names = [name for v in versions if (name := ctypes.util.find_library(f"LLVM-{v}"))]
    folders = [Path(f"/usr/lib/llvm-{v}/lib") for v in versions]
    folders += [Path("/opt/homebrew/opt/llvm/lib"), Path("/usr/local/opt/llvm/lib")]
    files = [folder / name for folder in folders for name in ("libLLVM.so.1", "libLLVM.dylib")]
    return [Path(name) for name in names] + [file for file in files if file.is_file()]


@cache
def usable_library() -> Path | None:
    """Return the LLVM to render with: the user's, the packaged one, or the system's; None if none is usable.

    Raises InputError if the user's choice cannot render.
    """
    packaged = packaged_library()
    chosen = os.environ.get(LIBRARY_VARIABLE)
    if chosen and Path(chosen) != packaged:
        if not can_render(LLVM, Path(chosen)):
            raise InputError(
                f"{LIBRARY_VARIABLE}={chosen}: Mitsuba cannot render with this LLVM, unset it or set another"
            )
        return Path(chosen)
    if packaged is not None and can_load(packaged):
        return packaged
    return next((library for library in _system_libraries() if can_render(LLVM, library)), None)


@cache
def choose_variant() -> str:
    """Return the fastest variant that this machine can render with."""
    if has_gpu() and can_render(CUDA):
        return CUDA
    if usable_library() is not None:
        return LLVM
    _log.warning(f"no usable LLVM, rendering hundreds of times slower: pip install {PACKAGE} or set {LIBRARY_VARIABLE}")
    return SCALAR


@cache
def _check_usable(variant: str) -> None:
    """Raise InputError unless a variant can run; for LLVM, point Dr.Jit at a library that it can use."""
    if variant.startswith("cuda") and not has_gpu():
        raise InputError(f"variant {variant} needs a GPU with a CUDA driver, found none")
    library = usable_library()
    if library is None:
        if variant.startswith("llvm"):
            raise InputError(f"variant {variant} needs an LLVM: pip install {PACKAGE} or set {LIBRARY_VARIABLE}")
        return
    if "drjit" not in sys.modules:
        os.environ[LIBRARY_VARIABLE] = str(library)
        return
    # Other code imported Dr.Jit, which has already chosen its library and cannot change it.
    loaded = importlib.import_module("drjit").detail.llvm_version()
    if variant.startswith("llvm") and loaded[0] <= _LAST_ABORTING_LLVM:
        version = ".".join(str(number) for number in loaded)
        raise InputError(f"drjit was imported with LLVM {version}, too old: set {LIBRARY_VARIABLE}={library} first")


def use_variant(variant: str | None = None, *, colour: bool = False) -> str:
    """Set Mitsuba's variant, by default the fastest usable one (monochrome, or RGB with `colour`); return its name.

    Raises InputError if Mitsuba is not installed, has no such variant, or cannot run it.
    """
    if importlib.util.find_spec("mitsuba") is None or importlib.util.find_spec("drjit") is None:
        raise InputError('rendering needs Mitsuba, which is not installed: pip install "mirrorcam[render]"')
    name = variant or (COLOUR_VARIANTS[choose_variant()] if colour else choose_variant())
    _check_usable(name)
    mi = importlib.import_module("mitsuba")
    if name not in mi.variants():
        raise InputError(f"variant {name!r} is unknown to Mitsuba, expected one of {', '.join(mi.variants())}")
    if mi.variant() != name:
        mi.set_variant(name)
    return name
