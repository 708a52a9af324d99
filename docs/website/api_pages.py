"""The reference of the library: a page of its public names."""

from __future__ import annotations

import inspect

import mirrorcam

GROUPS = {
    "Cameras and layouts": (
        "Camera",
        "DesignSpec",
        "Layout",
        "Mirror",
        "Uncertainty",
        "design",
        "build_parts",
        "designs_for",
        "TargetDesigns",
    ),
    "Backs of your own": ("MountFace", "Adapter", "Fastener"),
    "Calibration": (
        *(
            "AprilGrid",
            "Charuco",
            "Checkerboard",
            "load_board",
            "RequestedModel",
            "calibrate",
            "calibrate_from_corners",
            "calibrate_camera",
        ),
        *("Calibration", "CalibratedCamera"),
    ),
    "Pictures, videos and cameras": (
        *(
            "read_image",
            "open_video",
            "Video",
            "CameraBag",
            "open_camera",
            "LiveCamera",
            "NewestFrame",
            "Frame",
            "Lost",
            "ArrivedFrame",
        ),
    ),
    "Light fields and depth": (
        *("Decoder", "LightField", "Views", "open_light_field", "write_light_field"),
        *("estimate_depth", "DepthEstimator", "VideoDepth", "DepthMap"),
    ),
    "Rendered frames and sets": (
        *("SceneObject", "render_frame", "RenderSettings", "SensorModel", "Tolerances", "SetRequest", "render_set"),
        *("Dataset", "validate", "Validation"),
    ),
    "Figures and errors": ("Metric", "InputError", "InfeasibleDesign"),
}
"""The public names by purpose."""


def _directive(name: str, value: object) -> str:
    if not inspect.isclass(value):
        return f".. autofunction:: {name}\n"
    return f".. autoclass:: {name}\n   :members:\n   :exclude-members: model_config, model_post_init\n"


def _in_rst(directives: list[str]) -> str:
    return "```{eval-rst}\n" + "\n".join(directives) + "```\n"


def names_page() -> str:
    """The page of the public names."""
    lines = [
        "# Public names of the library\n",
        "Every name of `import mirrorcam`. [As a library](../library.md) shows how they work together, "
        "and [conventions](../conventions.md) defines frames, pixels and units. Lengths are in mm.\n",
    ]
    for title, names in GROUPS.items():
        directives = [_directive(f"mirrorcam.{name}", getattr(mirrorcam, name)) for name in names]
        lines.append(f"## {title}\n\n{_in_rst(directives)}")
    return "\n".join(lines)


def api_pages() -> dict[str, str]:
    """All pages of the library, by name."""
    return {"reference/names": names_page()}
