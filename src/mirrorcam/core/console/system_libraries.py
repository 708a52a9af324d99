"""Libraries of the system that the loader does not find, and the packages that hold them."""

from __future__ import annotations

import re

from mirrorcam.core.causes import causes

# Messages of glibc and of musl.
_NOT_FOUND = re.compile(
    r"(lib[\w.+-]*\.so[\w.]*): cannot open shared object|loading shared library (lib[\w.+-]*\.so[\w.]*)"
)
_PACKAGES = {
    "libGL.so.1": ("libgl1", "mesa-libGL"),
    "libGLU.so.1": ("libglu1-mesa", "mesa-libGLU"),
    "libEGL.so.1": ("libegl1", "mesa-libEGL"),
    "libGLX.so.0": ("libglx0", "libglvnd-glx"),
    "libOpenGL.so.0": ("libopengl0", "libglvnd-opengl"),
    "libX11.so.6": ("libx11-6", "libX11"),
    "libXcursor.so.1": ("libxcursor1", "libXcursor"),
    "libXext.so.6": ("libxext6", "libXext"),
    "libXfixes.so.3": ("libxfixes3", "libXfixes"),
    "libXft.so.2": ("libxft2", "libXft"),
    "libXi.so.6": ("libxi6", "libXi"),
    "libXinerama.so.1": ("libxinerama1", "libXinerama"),
    "libXrender.so.1": ("libxrender1", "libXrender"),
    "libxcb.so.1": ("libxcb1", "libxcb"),
    "libSM.so.6": ("libsm6", "libSM"),
    "libICE.so.6": ("libice6", "libICE"),
    "libatomic.so.1": ("libatomic1", "libatomic"),
    "libexpat.so.1": ("libexpat1", "expat"),
    "libfontconfig.so.1": ("libfontconfig1", "fontconfig"),
    "libfreetype.so.6": ("libfreetype6", "freetype"),
    "libglib-2.0.so.0": ("libglib2.0-0", "glib2"),
    "libgthread-2.0.so.0": ("libglib2.0-0", "glib2"),
    "libgomp.so.1": ("libgomp1", "libgomp"),
    "libstdc++.so.6": ("libstdc++6", "libstdc++"),
    "libvulkan.so.1": ("libvulkan1", "vulkan-loader"),
    "libz.so.1": ("zlib1g", "zlib"),
}
"""Packages of Debian and Ubuntu, and of Fedora, by the library that they contain."""


def missing_library(text: str) -> str | None:
    """Name the library that an error message reports as missing, and its package; None for other messages."""
    match = _NOT_FOUND.search(text)
    if match is None:
        return None
    name = match[1] or match[2]
    if name not in _PACKAGES:
        return f"the system library {name} is missing: install the system package that contains it"
    debian, fedora = _PACKAGES[name]
    return f"the system library {name} is missing: apt-get install {debian} (on Fedora, dnf install {fedora})"


def missing_library_of(error: BaseException) -> str | None:
    """Return `missing_library` for an error on import or loading, or for its causes."""
    loading = (cause for cause in causes(error) if isinstance(cause, ImportError | OSError))
    return next((sentence for cause in loading if (sentence := missing_library(str(cause)))), None)
