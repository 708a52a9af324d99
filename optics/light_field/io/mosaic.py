"""One picture for all views, as the formats `eslf` and `tiles` have it; weights are opacity, the views in NAME.json."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, views_toml
from mirrorcam.optics.light_field.io.mosaic_order import AXES, Order, check_division
from mirrorcam.optics.light_field.io.view_images import light_field_of, read_rgba, rgb, weight_bytes, write_rgba
from mirrorcam.optics.light_field.io.views_file import even_views, read_views, write_views
from mirrorcam.optics.light_field.light_field import LightField


def write_mosaic(path: Path, light_field: LightField, order: Order) -> None:
    """Write all views as one PNG."""
    rows, cols, height, width = light_field.weights.shape
    axes, size = AXES[order], (rows * height, cols * width)
    colours = rgb(light_field.samples).transpose(*axes, 4).reshape(*size, 3)
    opacity = weight_bytes(light_field.weights).transpose(axes).reshape(size)
    write_rgba(path, colours, None if light_field.weights.min() == 1.0 else opacity)
    channels = light_field.samples.shape[-1]
    write_views(path.with_suffix(".json"), light_field, order=order, channels=channels)


def read_mosaic(path: Path, order: Order, assumed: Assumed = NOTHING) -> LightField:
    """The light field of such a picture; what NAME.json says of it goes before `order` and `assumed`.

    Raises InputError in one line where the geometry is not known, the picture does not divide into the views, or its
    pixels show that it is divided otherwise.
    """
    colours, opacity = read_rgba(path)
    stated = read_views(path.with_suffix(".json"))
    stated_order: object = order
    if stated is not None:
        grid, stated_order = (stated[0].rows, stated[0].cols), stated[1].order
    elif assumed.rows is None or assumed.cols is None:
        raise InputError(
            f"{path}: a picture without {path.stem}.json, expected --layout of the camera whose frame it is, or rows "
            f"and cols of its views in {views_toml(path).name}"
        )
    else:
        grid = (assumed.rows, assumed.cols)
    if stated_order not in AXES:
        raise InputError(f"{path.with_suffix('.json')}: order is {stated_order!r}, expected 'eslf' or 'tiles'")
    height, width = (side // count for side, count in zip(opacity.shape, grid, strict=True))
    shape = (*grid, height, width)
    if (grid[0] * height, grid[1] * width) != opacity.shape or not height * width:
        raise InputError(
            f"{path}: {opacity.shape[1]}x{opacity.shape[0]} px do not divide into {grid[1]}x{grid[0]} views"
        )
    if stated is None:
        check_division(colours, grid, order)
    axes = AXES[str(stated_order)]
    parts, back = [shape[axis] for axis in axes], np.argsort(axes)
    views = even_views(path, assumed, grid, (width, height)) if stated is None else stated[0]
    if (views.width_px, views.height_px) != (width, height):
        raise InputError(f"{path}: views of {width}x{height} px, expected {views.width_px}x{views.height_px}")
    samples = colours.reshape(*parts, 3).transpose(*back, 4)
    channels = 3 if stated is None else stated[1].channels
    return light_field_of(views, np.ascontiguousarray(samples), opacity.reshape(parts).transpose(back), channels)
