"""The page of a gallery of devices: one card each; it works offline, from a local file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import Field

from mirrorcam.cad.plan.prices import hours_text
from mirrorcam.core.figures.figure_texts import SIGMA, TIMES, count_text, figure_text, number_word, sentence_case
from mirrorcam.core.html.templates import PageFile, PagePicture, render
from mirrorcam.core.names import Line, Name
from mirrorcam.core.values import Value

TEMPLATES = Path(__file__).parent
NBSP = "\N{NO-BREAK SPACE}"
ORDERS = (
    ("views", "fewest views first"),
    ("price", "lowest price first"),
    ("mass", "lightest first"),
    ("minutes", "shortest printing first"),
    ("sigma", f"smallest {SIGMA} of depth first"),
)
"""Orders of the cards: name of the figure, and text on the page."""


class AtDepth(Value):
    """Figures of a layout at one of its working depths; efficiencies are fractions of the sensor."""

    depth_mm: float
    pixel_efficiency: float
    usable_efficiency: float | None = None
    """None for a pinhole."""
    sigma_mm: float


class GalleryCard(Value):
    """The description of a device in the gallery.

    Attributes
    ----------
    views
        Arrangement of the views: "3 x 3", "hex7".
    mount
        The support of the device.
    mirrors
        Type of the mirrors, and how they are fixed.
    size_mm
        Width, height and depth of the device in use, along the axes of a level view.
    mass_g
        Mass with the parts as printed, camera included.
    print_minutes
        Time to print everything, None if no slicer is installed.
    focus_mm
        The best focus distance, None for a pinhole.
    checks
        Number of checks that the device passed.
    zip_bytes
        Size of the ZIP file of all files.
    """

    name: Name
    title: Name
    purpose: Line
    views: Name
    mirror_count: int = Field(ge=2)
    camera: Name
    mount: Name
    mirrors: Name
    fasteners: Name
    size_mm: tuple[float, float, float]
    mass_g: float
    price: float
    currency: Name
    print_minutes: float | None = None
    at_depths: tuple[AtDepth, ...] = Field(min_length=1)
    focus_mm: float | None = None
    checks: int
    zip_bytes: int

    @property
    def working(self) -> AtDepth:
        """The figures at the nearest working depth."""
        return min(self.at_depths, key=lambda at: at.depth_mm)

    @property
    def facts(self) -> list[tuple[str, str]]:
        """Names and texts of the facts on a card."""
        size = f"{NBSP}{TIMES} ".join(f"{length:.0f}" for length in self.size_mm)
        return [
            ("Views", f"{self.views.replace(' x ', f' {TIMES} ')}, {count_text(self.mirror_count, 'mirror')}"),
            ("Camera", self.camera),
            ("Carried by", self.mount),
            ("Mirrors", self.mirrors),
            ("Threads", self.fasteners),
            ("Size", f"{size}{NBSP}mm"),
            ("Mass", f"{self.mass_g:.0f} g"),
            ("Price, estimated", f"{self.price:.0f} {self.currency}"),
            ("Printing", "unknown" if self.print_minutes is None else hours_text(self.print_minutes)),
            ("Seen by all views", _range_text(f"{at.pixel_efficiency:.0%}" for at in self.at_depths)),
            *(
                [("Usable by the full pupil", _range_text(f"{at.usable_efficiency:.0%}" for at in self.at_depths))]
                if all(at.usable_efficiency is not None for at in self.at_depths)
                else []
            ),
            *([("Focus locked at", f"{self.focus_mm:.0f}{NBSP}mm")] if self.focus_mm is not None else []),
            (
                f"{SIGMA} of depth",
                "; ".join(f"{figure_text(at.sigma_mm, 2)}{NBSP}mm at {at.depth_mm:g}{NBSP}mm" for at in self.at_depths),
            ),
        ]

    @property
    def order(self) -> dict[str, float]:
        """The figures that cards can be ordered by, as `ORDERS` names them."""
        return {
            "views": self.mirror_count,
            "price": self.price,
            "mass": self.mass_g,
            "minutes": -1.0 if self.print_minutes is None else self.print_minutes,
            "sigma": self.working.sigma_mm,
        }

    @property
    def page(self) -> str:
        """The device's own page, relative to the page of the gallery."""
        return f"{self.name}/cad/index.html"

    @property
    def picture(self) -> str:
        """The device's picture, relative to the page of the gallery."""
        return f"{self.name}/picture/device.jpg"

    @property
    def zip(self) -> str:
        """The ZIP file of the device's files, relative to the page of the gallery."""
        return f"{self.name}/files/{self.name}.zip"


def _range_text(texts: Iterable[str]) -> str:
    """The first and last of some texts joined by "to", or the text that all of them share."""
    values = list(texts)
    return values[0] if len(set(values)) == 1 else " to ".join((values[0], values[-1]))


def gallery_html(cards: Sequence[GalleryCard], picture_px: tuple[int, int], *, command: str) -> str:
    """The page. All external text is escaped; links are relative, with forward slashes.

    Parameters
    ----------
    cards
        The devices, in their initial order.
    picture_px
        Width and height of all pictures.
    command
        The command that the page names as its origin.
    """
    unsliced = [card.title for card in cards if card.print_minutes is None]
    return render(
        TEMPLATES,
        "gallery_page.html",
        title="MirrorCam: light field cameras to print",
        heading=sentence_case(f"{number_word(len(cards))} light field camera{'' if len(cards) == 1 else 's'} to print"),
        cards=cards,
        pictures=[
            PagePicture(card.picture, card.page, picture_px, f"{card.title}, from the front and from the side")
            for card in cards
        ],
        files=[
            [
                PageFile(card.zip, f"all files, {card.zip_bytes / 1e6:.0f} MB: unpack it, open index.html there"),
                PageFile(f"{card.name}/cad/guide.md", "the assembly guide, to print"),
                PageFile(f"{card.name}/design/layout.json", "the layout, by which the camera is calibrated later"),
            ]
            for card in cards
        ],
        orders=ORDERS,
        mounts=sorted({card.mount for card in cards}),
        counts=sorted({card.mirror_count for card in cards}),
        unsliced=unsliced,
        command=command,
    )
