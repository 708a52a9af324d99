"""The reference of the library: a page of its public names."""

from __future__ import annotations

import inspect

import mirrorcam

GROUPS = {
    "Cameras and layouts": ("Camera", "DesignSpec", "Layout", "design", "build_parts"),
    "Backs of your own": ("MountFace", "Adapter", "Fastener"),
    "Calibration": ("AprilGrid", "Charuco", "Checkerboard", "RequestedModel", "calibrate", "calibrate_camera"),
    "Light fields and depth": (
        *("Decoder", "LightField", "open_light_field", "write_light_field", "estimate_depth", "read_image"),
    ),
    "Synthetic sets": ("RenderSettings", "SetRequest", "render_set", "validate"),
    "Errors": ("InputError",),
}
"""The public names by purpose."""
RELATED = {
    "Cameras and layouts": ("optics.geometry.mirror.Mirror", "core.values.Metric"),
    "Calibration": ("optics.calibration.calibration.Calibration",),
    "Light fields and depth": (
        "optics.light_field.light_field.Views",
        "optics.light_field.depth.estimate.DepthMap",
        "optics.light_field.depth.estimate.DepthEstimator",
    ),
    "Synthetic sets": ("render_scenes.sets.dataset.Dataset",),
}
"""Other types that the public functions take or return, with their modules."""


def _directive(name: str, value: object) -> str:
    if not inspect.isclass(value):
        return f".. autofunction:: {name}\n"
    return f".. autoclass:: {name}\n   :members:\n   :exclude-members: model_config, model_post_init\n"


def _in_rst(directives: list[str]) -> str:
    return "```{eval-rst}\n" + "\n".join(directives) + "```\n"


def names_page() -> str:
    """The page of the public names and the related types."""
    lines = [
        "# Public names of the library\n",
        "Every name of `import mirrorcam`. [As a library](../library.md) shows how they work together, "
        "and [conventions](../conventions.md) defines frames, pixels and units. Lengths are in mm.\n",
    ]
    for title, names in GROUPS.items():
        directives = [_directive(f"mirrorcam.{name}", getattr(mirrorcam, name)) for name in names]
        for path in RELATED.get(title, ()):
            module, _, name = path.rpartition(".")
            value = getattr(__import__(f"mirrorcam.{module}", fromlist=[name]), name)
            directives.append(_directive(f"mirrorcam.{path}", value))
        lines.append(f"## {title}\n\n{_in_rst(directives)}")
    return "\n".join(lines)


def api_pages() -> dict[str, str]:
    """All pages of the library, by name."""
    return {"reference/names": names_page()}
