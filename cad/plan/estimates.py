"""Size, mass, plastic, printing time and price of a device from its layout alone, in milliseconds.

No part is planned. Mirrors, camera and lean are exact; the parts around them follow from few coefficients with a
physical meaning, fitted to devices as built and sliced. `python -m benchmarks.device_estimates` prints the errors for
devices that the fit has not seen, which the estimates state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import Field
from shapely import MultiPoint, Polygon

from mirrorcam.cad.plan.hardware import HARDWARE, MIRROR_DENSITIES, Hardware
from mirrorcam.cad.plan.rectangles import is_sold_in_size
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.cad.plan.stand import lean_deg, rig_from_stand
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry.design_spec import box_corners
from mirrorcam.optics.geometry.layout import Layout

# Grams of the holder per cm2 of its back and per cm2 of its rims, the mirrors' edges.
HOLDER_G_PER_CM2, RIM_G_PER_CM2 = 0.53, 0.0
# Grams of the mount per cm2 of its width times the device's height, and its smallest width: that of the clip's screws.
MOUNT_G_PER_CM2, MOUNT_MM = 0.495, 51.6
# Grams of the camera clip per cm2 of the camera's body, and of plate and fit coupon together.
CLIP_G_PER_CM2, REST_G, COUPON_G = 0.163, 5.9, 9.4
# Printing time per gram of plastic.
H_PER_G = 0.0497
# Mass of the fasteners.
FASTENERS_G = 18.0
# Prices of the fasteners.
FASTENERS_EUR = 4.3
# Share of a sheet of stock that is used at most, with the gaps between mirrors.
SHEET_USE = 0.8
# How far the device reaches beyond mirrors and camera, mm, along the stand's x, y and z.
BEYOND_MIRRORS_MM = np.array([[3.0, 40.0, 0.0], [3.0, 0.0, 19.0]])
BEYOND_CAMERA_MM = np.array([[4.8, 12.0, 45.0], [17.6, 12.3, 0.0]])
# Errors of the estimates: standard deviations relative to the figures of devices that the fit has not seen.
SIZE_ERROR, MASS_ERROR, PLASTIC_ERROR, PRINT_ERROR, PRICE_ERROR = 0.03, 0.05, 0.05, 0.05, 0.02


class DeviceEstimate(Value):
    """Estimated figures of a device on its stand with its camera, each with the standard deviation of its error."""

    size_mm: tuple[float, float, float] = Field(description="width, height and depth in use")
    size_error_mm: float = Field(description="standard deviation of the largest of them")
    mass_g: float = Field(description="mass as printed, with the camera")
    mass_error_g: float
    plastic_g: float = Field(description="plastic of all prints, with the fit coupon")
    plastic_error_g: float
    print_h: float = Field(description="time of all prints")
    print_error_h: float
    price_eur: float = Field(description="price of everything, in the currency of the hardware's prices")
    price_error_eur: float
    camera_eur: float = Field(description="the camera's share of the price; 0 if its price is unknown")


def estimate_device(layout: Layout, hardware: Hardware = HARDWARE) -> DeviceEstimate:
    """Estimate the figures of a layout's device.

    Parameters
    ----------
    layout
        Layout of any kind.
    hardware
        Dimensions and prices; its camera body and mirror material are the layout's unless they are given. The estimates
        are for glued mirrors, the adapter for a desk, and the default dimensions.

    Returns
    -------
    DeviceEstimate
        The figures, with standard deviations.

    Raises
    ------
    InputError
        If the views look so steeply that no device stands like this (`lean_deg`).
    """
    hardware = hardware.for_layout(layout)
    parts = _Parts(layout, hardware)
    size = parts.size_mm
    plastic_g = parts.plastic_g
    mass_g = plastic_g - COUPON_G + parts.mirrors_g + hardware.camera.mass_g + FASTENERS_G
    print_h = H_PER_G * plastic_g
    camera_eur = hardware.prices.of_item(hardware.camera.name) or 0.0
    price = parts.price(plastic_g) + camera_eur
    return DeviceEstimate(
        size_mm=(float(size[0]), float(size[2]), float(size[1])),
        size_error_mm=SIZE_ERROR * float(size.max()),
        mass_g=mass_g,
        mass_error_g=MASS_ERROR * mass_g,
        plastic_g=plastic_g,
        plastic_error_g=PLASTIC_ERROR * plastic_g,
        print_h=print_h,
        print_error_h=PRINT_ERROR * print_h,
        price_eur=price,
        price_error_eur=PRICE_ERROR * price,
        camera_eur=camera_eur,
    )


@dataclass(frozen=True, eq=False)
class _Parts:
    """Measures of a device that follow from its layout."""

    layout: Layout
    hardware: Hardware

    @cached_property
    def prisms(self) -> list[FloatArray]:
        """Corners of each mirror: (n, 3) of its back, then of its front, in the rig frame."""
        return [np.vstack([prism.base, prism.top]) for prism in map(mirror_prism, self.layout.mirrors)]

    @cached_property
    def size_mm(self) -> FloatArray:
        """Size (3,) along the stand's x (right), y (forward) and z (up)."""
        turn = rig_from_stand(lean_deg(self.layout, self.hardware))
        mirrors, camera = np.vstack(self.prisms) @ turn, box_corners(*self.hardware.camera.box_mm) @ turn
        low = np.minimum(mirrors.min(axis=0) - BEYOND_MIRRORS_MM[0], camera.min(axis=0) - BEYOND_CAMERA_MM[0])
        high = np.maximum(mirrors.max(axis=0) + BEYOND_MIRRORS_MM[1], camera.max(axis=0) + BEYOND_CAMERA_MM[1])
        return np.asarray(high - low)

    @cached_property
    def back_cm2(self) -> float:
        """Area of the holder's back: the outline of all mirrors along their mean normal."""
        normal = np.mean([mirror.normal_in_rig for mirror in self.layout.mirrors], axis=0)
        axes = np.linalg.svd(normal[None])[2][1:]
        return float(MultiPoint(np.vstack(self.prisms) @ axes.T).convex_hull.area) / 100.0

    @cached_property
    def rims_cm2(self) -> float:
        """Area of the mirrors' edges."""
        outlines = (Polygon(mirror.outline_in_plane_mm).length * mirror.thickness_mm for mirror in self.layout.mirrors)
        return sum(outlines) / 100.0

    @cached_property
    def mirrors_cm2(self) -> float:
        """Area of all mirrors."""
        return sum(Polygon(mirror.outline_in_plane_mm).area for mirror in self.layout.mirrors) / 100.0

    @property
    def mirrors_g(self) -> float:
        """Mass of the mirrors."""
        volumes = (Polygon(m.outline_in_plane_mm).area * m.thickness_mm / 1000.0 for m in self.layout.mirrors)
        return MIRROR_DENSITIES[self.hardware.cutting.material] * sum(volumes)

    @property
    def plastic_g(self) -> float:
        """Plastic of all prints."""
        camera = self.hardware.camera
        sides = camera.width_mm * camera.height_mm + (camera.width_mm + camera.height_mm) * camera.depth_mm
        width_mm = max(MOUNT_MM, self.hardware.holder.mount_of_width * float(self.size_mm[0]))
        return (
            HOLDER_G_PER_CM2 * self.back_cm2
            + RIM_G_PER_CM2 * self.rims_cm2
            + MOUNT_G_PER_CM2 * width_mm * float(self.size_mm[2]) / 100.0
            + CLIP_G_PER_CM2 * 2.0 * sides / 100.0
            + REST_G
            + COUPON_G
        )

    def price(self, plastic_g: float) -> float:
        """Price of everything but the camera."""
        prices, cutting, mirrors = self.hardware.prices, self.hardware.cutting, self.layout.mirrors
        stocks = {cutting.stock(mirror.surface, mirror.thickness_mm) for mirror in mirrors}
        glue = prices.of_item("Glue for mirrors") or 0.0
        filament = prices.of_plastic(self.hardware.printer.plastic, plastic_g)
        if is_sold_in_size(self.layout):
            stock = prices.of_mirror_pieces(max(stocks), len(mirrors) + 1)
        else:
            sheet_cm2 = cutting.sheet_mm[0] * cutting.sheet_mm[1] / 100.0
            sheets = math.ceil(self.mirrors_cm2 / (SHEET_USE * sheet_cm2))
            stock = sum(prices.of_mirrors(name, sheets * sheet_cm2) for name in stocks) / len(stocks)
        return stock + filament + FASTENERS_EUR + glue
