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

from mirrorcam.cad.plan.hardware import HARDWARE, MIRROR_DENSITIES, Hardware, mirror_weight_n
from mirrorcam.cad.plan.rectangles import is_sold_in_size
from mirrorcam.cad.plan.seats import Frustum, mirror_prism
from mirrorcam.cad.plan.stand import lean_deg, rig_from_stand
from mirrorcam.core.values import FloatArray, Value
from mirrorcam.optics.geometry.design_spec import box_corners
from mirrorcam.optics.geometry.layout import Layout

GRAVITY_N_PER_G = 9.80665e-3
# Holder: grams per cm2 of its back, per cm of the back's outline with its walls, and per cm3 between back and mirrors.
HOLDER_G = (0.335, 0.322, 0.126)
# Mount and plate: grams per cm2 of the mount's width times its length, and per gram of load and (10 cm)^2 of height,
# since the mount is as stiff as its load needs.
MOUNT_G = (0.429, 0.0254)
# Width of the narrowest mount, which the clip's screws need, and the width of a mount beside the holder's screws.
MOUNT_MM, MOUNT_BESIDE_MM = 51.6, 13.0
# Clip: grams, and grams per cm2 of the camera's surface. Fit coupon: grams.
CLIP_G, COUPON_G = (4.14, 0.129), 8.9
# Hours of printing per gram of plastic, per mirror, and per device.
PRINT_H = (0.0422, 0.0359, 0.531)
# Fasteners of all devices, and those that press a camera against its clip.
JOINTS_G, SPRUNG_G = 16.8, 5.3
JOINTS_EUR, SPRUNG_EUR = 3.2, 1.1
# Largest share of a sheet of stock that becomes mirrors.
SHEET_USE = 0.7
# How far the device reaches past the mirrors and past the camera, mm, to the left and to the right.
PAST_MIRRORS_MM, PAST_CAMERA_MM = (3.0, 3.0), (4.8, 17.6)
# Size past the camera, of the height for an upright device, and per mm of the mirrors' reach, which the mount exceeds.
HEIGHT, DEPTH = (34.4, 1.24), (36.3, 1.34)
# Standard deviations of the errors, relative to the figures.
SIZE_ERROR, MASS_ERROR, PLASTIC_ERROR, PRINT_ERROR, PRICE_ERROR = 0.043, 0.023, 0.041, 0.033, 0.003


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
    mirrors_eur: float = Field(description="the share of the mirrors and their glue")

    @property
    def text(self) -> str:
        """Size, mass, price with its shares, and printing time in one line."""
        size = " x ".join(f"{side:.0f}" for side in self.size_mm)
        return f"{size} mm, {self.mass_g:.0f} g, {self.price_eur:.0f} EUR ({self.price_text}), {self.print_h:.1f} h"

    @property
    def price_text(self) -> str:
        """The shares of the price, such as "camera 70, mirrors 46, other 16"."""
        other_eur = self.price_eur - self.camera_eur - self.mirrors_eur
        camera = f"camera {self.camera_eur:.0f}" if self.camera_eur else "camera unknown"
        return f"{camera}, mirrors {self.mirrors_eur:.0f}, other {other_eur:.0f}"


def estimate_device(layout: Layout, hardware: Hardware = HARDWARE) -> DeviceEstimate:
    """Estimate the figures of a layout's device.

    Parameters
    ----------
    layout
        Layout of any kind.
    hardware
        Dimensions and prices; its camera body and mirror material are the layout's unless they are given. The estimates
        are for glued mirrors, the adapter for a desk, and the default dimensions and speeds of the printer.

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
    device = DeviceMeasures(layout, hardware)
    size = device.size_mm
    printed_g = device.printed_g
    plastic_g = printed_g + COUPON_G
    is_pressed = hardware.camera.held_by.kind == "lips"
    fasteners_g, fasteners_eur = JOINTS_G + SPRUNG_G * is_pressed, JOINTS_EUR + SPRUNG_EUR * is_pressed
    mass_g = printed_g + device.mirrors_g + hardware.camera.mass_g + fasteners_g
    print_h = float(np.array(PRINT_H) @ [plastic_g, len(layout.mirrors), 1.0])
    camera_eur = hardware.prices.of_item(hardware.camera.name) or 0.0
    filament_eur = hardware.prices.of_plastic(hardware.printer.plastic, plastic_g)
    price = camera_eur + device.mirrors_eur + filament_eur + fasteners_eur
    return DeviceEstimate(
        size_mm=size,
        size_error_mm=SIZE_ERROR * max(size),
        mass_g=mass_g,
        mass_error_g=MASS_ERROR * mass_g,
        plastic_g=plastic_g,
        plastic_error_g=PLASTIC_ERROR * plastic_g,
        print_h=print_h,
        print_error_h=PRINT_ERROR * print_h,
        price_eur=price,
        price_error_eur=PRICE_ERROR * price,
        camera_eur=camera_eur,
        mirrors_eur=device.mirrors_eur,
    )


@dataclass(frozen=True, eq=False)
class DeviceMeasures:
    """Measures of a device that follow from its layout and its hardware."""

    layout: Layout
    hardware: Hardware

    @cached_property
    def prisms(self) -> list[Frustum]:
        """The mirrors as cut, in the rig frame."""
        return [mirror_prism(mirror) for mirror in self.layout.mirrors]

    @cached_property
    def lean_deg(self) -> float:
        """The angle by which the device leans back from upright."""
        return lean_deg(self.layout, self.hardware)

    @cached_property
    def extremes_mm(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Lowest and highest coordinates (3,) in the stand frame of the mirrors, then of the camera with its posts."""
        lean, body = self.lean_deg, self.hardware.camera
        corners = np.vstack([face for prism in self.prisms for face in (prism.base, prism.top)])
        mirrors, camera = corners @ rig_from_stand(lean), box_corners(*body.box_mm) @ rig_from_stand(lean)
        posts_mm = body.held_by.post_mm if body.held_by.kind == "board" else 0.0
        below = np.array([0.0, 0.0, posts_mm * math.cos(math.radians(lean))])
        return mirrors.min(axis=0), mirrors.max(axis=0), camera.min(axis=0) - below, camera.max(axis=0)

    @property
    def camera_reach_mm(self) -> tuple[float, float]:
        """How far the camera reaches below and in front of the pupil."""
        _, _, low, high = self.extremes_mm
        return -float(low[2]), float(high[1])

    @property
    def mirrors_reach_mm(self) -> tuple[float, float]:
        """How far the mirrors reach above and behind the pupil."""
        low, high, _, _ = self.extremes_mm
        return float(high[2]), -float(low[1])

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Width, height and depth of the device in use."""
        mirrors_low, mirrors_high, camera_low, camera_high = self.extremes_mm
        left = min(mirrors_low[0] - PAST_MIRRORS_MM[0], camera_low[0] - PAST_CAMERA_MM[0])
        right = max(mirrors_high[0] + PAST_MIRRORS_MM[1], camera_high[0] + PAST_CAMERA_MM[1])
        (below_mm, front_mm), (above_mm, behind_mm) = self.camera_reach_mm, self.mirrors_reach_mm
        height_mm = below_mm + HEIGHT[0] / math.cos(math.radians(self.lean_deg)) + HEIGHT[1] * above_mm
        return float(right - left), height_mm, front_mm + DEPTH[0] + DEPTH[1] * behind_mm

    @cached_property
    def holder(self) -> FloatArray:
        """Area of the holder's back, cm2, length of its outline, cm, and volume between it and the mirrors, cm3.

        The back is normal to the mirrors' mean normal, and touches the mirror that reaches farthest back.
        """
        normal = np.mean([mirror.normal_in_rig for mirror in self.layout.mirrors], axis=0)
        axes = np.linalg.svd(normal[None])[2]
        backs = [prism.base @ (axes * np.sign(axes[0] @ normal)).T for prism in self.prisms]
        outline = MultiPoint(np.vstack(backs)[:, 1:]).convex_hull
        farthest = min(float(back[:, 0].min()) for back in backs)
        volume = sum(Polygon(back[:, 1:]).area * float(back[:, 0].mean() - farthest) for back in backs)
        return np.array([outline.area / 100.0, outline.length / 10.0, volume / 1000.0])

    @property
    def mount(self) -> FloatArray:
        """Width of the mount times its length, cm2, and its load, g, times the height squared, in (10 cm)^2."""
        mirrors_low, mirrors_high, _, _ = self.extremes_mm
        screws_mm = self.hardware.holder.mount_of_width * float(mirrors_high[0] - mirrors_low[0])
        width_mm, height_mm = max(MOUNT_MM, screws_mm + MOUNT_BESIDE_MM), self.size_mm[1]
        length_mm = height_mm / math.cos(math.radians(self.lean_deg))
        load_g = float(self.holder @ HOLDER_G) + self.mirrors_g
        return np.array([width_mm * length_mm / 100.0, load_g * (height_mm / 100.0) ** 2])

    @property
    def camera_cm2(self) -> float:
        """Surface of the camera's body."""
        body = self.hardware.camera
        sides = body.width_mm * body.height_mm + (body.width_mm + body.height_mm) * body.depth_mm
        return 2.0 * sides / 100.0

    @property
    def printed_g(self) -> float:
        """Plastic of holder, mount, plate and clip."""
        clip_g = CLIP_G[0] + CLIP_G[1] * self.camera_cm2
        return float(self.holder @ HOLDER_G) + float(self.mount @ MOUNT_G) + clip_g

    @cached_property
    def mirrors_g(self) -> float:
        """Mass of the mirrors."""
        density = MIRROR_DENSITIES[self.hardware.cutting.material]
        return sum(mirror_weight_n(mirror, density) for mirror in self.layout.mirrors) / GRAVITY_N_PER_G

    @property
    def mirrors_eur(self) -> float:
        """Price of the glue and of the mirrors: of whole sheets of stock, or of pieces with a spare one."""
        prices, cutting, mirrors = self.hardware.prices, self.hardware.cutting, self.layout.mirrors
        mirror = max(mirrors, key=lambda mirror: mirror.thickness_mm)
        stock, glue = cutting.stock(mirror.surface, mirror.thickness_mm), prices.of_item("Glue for mirrors") or 0.0
        if is_sold_in_size(self.layout):
            return prices.of_mirror_pieces(stock, len(mirrors) + 1) + glue
        areas = (Polygon(mirror.outline_in_plane_mm).area for mirror in mirrors)
        sheet_mm2 = cutting.sheet_mm[0] * cutting.sheet_mm[1]
        return prices.of_mirrors(stock, math.ceil(sum(areas) / (SHEET_USE * sheet_mm2)) * sheet_mm2 / 100.0) + glue
