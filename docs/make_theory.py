"""Draw the figures of docs/theory.md from a layout: `python docs/make_theory.py [LAYOUT]`.

By default, from the layout of the default design in tests/data. The same layout gives the same bytes.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import NullLocator

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.depth_sigma import depth_sigma_mm
from mirrorcam.optics.design.assess.layout_metrics import fitted_grid
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.sub_images import common_region, region_outline_px

DOCS = Path(__file__).parent
LAYOUT = DOCS.parent / "tests" / "data" / "default_layout.json"
MIRROR, VIEW, RAY, COMMON, CAMERA, FAINT = "#2f5f8f", "#b3261e", "#a86b00", "#1b7837", "#222222", "#777777"
DEPTH_MM = 400.0
STYLE: dict[Any, Any] = {
    "svg.hashsalt": "mirrorcam",
    "font.size": 11.0,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def mirrors(axes: Axes, layout: Layout) -> None:
    """The central column of mirrors from the side: pupil, virtual centres, rays to a point, and unfolded rays."""
    side = (layout.view_from_rig[2], -layout.view_from_rig[1])  # depth to the right, up is up

    def flat(points: FloatArray) -> FloatArray:
        return np.stack([points @ side[0], points @ side[1]], axis=-1)

    centre_xy = layout.virtual_centres_in_view_mm.reshape(-1, 3)[:, :2].mean(axis=0)
    target = np.array([*centre_xy, DEPTH_MM]) @ layout.view_from_rig
    column = layout.cols // 2
    for row in range(layout.rows):
        mirror = layout.mirrors[row * layout.cols + column]
        centre = mirror.virtual_centre_in_rig_mm
        image = reflect(target, centre)
        hit = image * (0.5 * centre @ centre) / (image @ centre)
        outline = flat(mirror.outline_in_rig_mm)
        ends = outline[[outline[:, 1].argmax(), outline[:, 1].argmin()]]
        axes.plot(*ends.T, color=MIRROR, linewidth=3.5, solid_capstyle="butt")
        axes.plot(*flat(np.array([np.zeros(3), hit, target])).T, color=RAY, linewidth=1.2)
        axes.plot(*flat(np.array([hit, centre])).T, color=RAY, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.plot(*flat(np.array([np.zeros(3), centre])).T, color=FAINT, linewidth=0.7, linestyle=":")
        axes.plot(*flat(centre), marker="o", color=VIEW, markersize=6)
    axes.plot(0.0, 0.0, marker="o", color=CAMERA, markersize=7)
    axes.plot(*flat(target), marker="*", color=COMMON, markersize=12)
    centres = flat(layout.virtual_centres_in_rig_mm)
    label: dict[str, Any] = {"fontsize": 11, "ha": "center"}
    axes.annotate("pupil of the camera", (0, 0), (0, -17), color=CAMERA, va="top", **label)
    lowest = centres[:, 1].min()
    axes.text(centres[:, 0].mean(), lowest - 14, "virtual cameras", color=VIEW, va="top", **label)
    top = flat(layout.mirrors[column].outline_in_rig_mm)
    axes.text(top[:, 0].mean(), top[:, 1].max() + 8, "mirrors", color=MIRROR, **label)
    axes.text(DEPTH_MM, flat(target)[1] + 11.0, "a point of the scene", color=COMMON, **label)
    axes.set(xlabel="depth, mm", ylabel="up, mm", aspect="equal")
    axes.set_ylim(-45.0, axes.get_ylim()[1] + 8.0)
    axes.set_xlim(axes.get_xlim()[0] - 25.0, DEPTH_MM + 40.0)


def sensor(axes: Axes, layout: Layout) -> None:
    """The sub-images on the sensor, and in each the region that all views see at one depth."""
    region, _ = common_region(layout, DEPTH_MM)
    for index, name in enumerate(layout.mirror_names):
        outline = layout.outline_px(index)
        axes.add_patch(Polygon(outline, closed=True, facecolor="#dce6f1", edgecolor=MIRROR, linewidth=1.2))
        axes.add_patch(Polygon(region_outline_px(layout, region, DEPTH_MM, index), facecolor=COMMON, alpha=0.35))
        u, v = outline.mean(axis=0)
        axes.text(u, v, name, ha="center", va="center", fontsize=11)
    width, height = layout.camera.width_px, layout.camera.height_px
    axes.add_patch(Polygon([(0, 0), (width, 0), (width, height), (0, height)], fill=False, edgecolor=CAMERA))
    axes.set(xlim=(-20, width + 20), ylim=(height + 20, -20), xlabel="u, px", ylabel="v, px", aspect="equal")


def positions(axes: Axes, layout: Layout) -> None:
    """The virtual centres as the scene sees them, and the regular grid that fits them best."""
    views = layout.virtual_centres_in_view_mm.reshape(-1, 3)[:, :2]
    grid = fitted_grid(layout)[0].reshape(-1, 3)[:, :2]
    axes.plot(*grid.T, "+", color=FAINT, markersize=12)
    axes.plot(*views.T, "o", color=VIEW, markersize=7)
    for name, position in zip(layout.mirror_names, views, strict=True):
        axes.annotate(name, position, (6, 6), textcoords="offset points", fontsize=10)
    axes.set(xlabel="x, mm", ylabel="y, mm", aspect="equal", title="views")
    axes.margins(0.2)
    axes.invert_yaxis()


def slopes(axes: Axes, layout: Layout) -> None:
    """Lines of points at several depths over the position of the view: a schematic epipolar-plane image."""
    focal = layout.camera.fx_px
    x = np.linspace(-40.0, 40.0, 2)
    for depth, point, color in ((280.0, -45.0, RAY), (400.0, 0.0, COMMON), (800.0, 130.0, VIEW)):
        u = focal * point / depth + focal * x * (1.0 / DEPTH_MM - 1.0 / depth)
        axes.plot(u, x, color=color, linewidth=2)
        axes.annotate(f"{depth:g} mm", (u[0], x[0]), (0, 6), textcoords="offset points", ha="center", color=color)
    rows = layout.virtual_centres_in_view_mm[layout.rows // 2]
    for x_mm in rows[:, 0] - rows[layout.cols // 2, 0]:
        axes.axhline(x_mm, color=FAINT, linewidth=0.7, linestyle=":")
    axes.set(xlabel="u from the principal point, px", ylabel="x of the view, mm", title="one row of all views")
    axes.invert_yaxis()
    axes.margins(0.12)


def depth_errors(axes: Axes, layout: Layout) -> None:
    """Standard deviation of depth over depth: the bound of this layout, and the effect of relative tilts of mirrors."""
    depths = np.geomspace(200.0, 3000.0, 60)
    centre = layout.virtual_centres_in_view_mm.reshape(-1, 3).mean(axis=0)
    points = np.stack([np.full(60, centre[0]), np.full(60, centre[1]), depths], axis=-1)
    sigma = depth_sigma_mm(layout, points)
    axes.loglog(depths, sigma, color=VIEW, linewidth=2, label="matching 5 x 5 px with a C920's noise")
    for tilt_deg, style in ((0.001, "--"), (0.01, ":")):
        error = tilt_error_mm(layout, np.radians(tilt_deg), depths - centre[2])
        axes.loglog(
            depths, error, color=MIRROR, linestyle=style, label=f"unknown tilts of {tilt_deg:g}° of all mirrors"
        )
    axes.set(xlabel="depth, mm", ylabel="standard deviation of depth, mm")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks([200, 400, 1000, 3000], ["200", "400", "1000", "3000"])
    axes.grid(True, which="major", color="#dddddd")
    axes.legend(frameon=False)


def tilt_error_mm(layout: Layout, tilt_rad: float, distance_mm: FloatArray) -> FloatArray:
    """Standard deviation of depth, at a distance from the views, if each mirror has an unknown tilt about two axes.

    A view rotates by about twice the tilt of its mirror. At the distance D, the depth by least squares over all
    baselines b_i therefore changes by 2 tilt D^2 / sqrt(sum |b_i - mean of b|^2).
    """
    baselines = layout.virtual_centres_in_view_mm.reshape(-1, 3)[:, :2]
    spread = np.linalg.norm(baselines - baselines.mean(axis=0))
    return np.asarray(2.0 * tilt_rad * distance_mm**2 / spread)


def draw(layout: Layout, folder: Path) -> None:
    """Write all figures as SVG."""
    with matplotlib.rc_context(STYLE):
        for name, size, panels in (
            ("theory_mirrors", (9.0, 3.3), (mirrors,)),
            ("theory_sensor", (7.0, 4.3), (sensor,)),
            ("theory_light_field", (9.0, 4.0), (positions, slopes)),
            ("theory_depth", (7.0, 4.2), (depth_errors,)),
        ):
            figure = Figure(figsize=size, layout="constrained")
            for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
                panel(axes, layout)
            with atomic(folder / f"{name}.svg") as temporary:
                figure.savefig(temporary, format="svg", metadata={"Date": None})


def main() -> None:
    """Draw the figures of one layout."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("layout", type=Path, nargs="?", default=LAYOUT)
    draw(Layout.load(parser.parse_args().layout), DOCS / "images")


if __name__ == "__main__":
    main()
