"""The pieces of each step of the assembly, for the pictures and the guide."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.assembly.build_steps import CAMERA, is_piece_of
from mirrorcam.cad.assembly.pieces import Piece
from mirrorcam.cad.plan.device_names import CARRIER, CLIP, HOLDER, MOUNT
from mirrorcam.core.figures.figure_texts import TIMES

# Prefix of the names of a back's parts.
ADAPTER = "adapter"


def joins_of(piece: Piece) -> tuple[str, ...]:
    """The parts that a fastener joins, the outer part first; () for other pieces."""
    return piece.item.joins if piece.item else ()


def belongs(part: Piece, name: str) -> bool:
    """Return whether a printed part is the named one or a piece of it, such as "mount_1" of "mount"."""
    return is_piece_of(part.name, re.escape(name))


def home_of(fastener: Piece, name: str, parts: Iterable[Piece]) -> Piece | None:
    """The named part that contains a fastener, or its nearest piece if it is split; None if there is none."""
    centre = np.asarray(fastener.mesh.bounds).mean(axis=0)

    def distance(part: Piece) -> float:
        low, high = np.asarray(part.mesh.bounds)
        return float(np.linalg.norm(centre - np.clip(centre, low, high)))

    return min((part for part in parts if belongs(part, name)), key=distance, default=None)


def counted(pieces: Iterable[Piece]) -> str:
    """A list of pieces with their counts, "4 × M3 x 12 screws, 1 × M3 nut"; "" for none."""
    counts = Counter(piece.title for piece in pieces)
    return ", ".join(f"{count} {TIMES} {title}{'' if count == 1 else 's'}" for title, count in counts.items())


@dataclass(frozen=True)
class Stages:
    """All pieces of a device, grouped by the steps that need them."""

    pieces: Sequence[Piece]

    def printed(self, *stems: str) -> list[Piece]:
        """Printed parts with these prefixes, which include all pieces of a split part."""
        return [piece for piece in self.pieces if piece.kind == "part" and piece.name.startswith(stems)]

    def of_kind(self, *kinds: str) -> list[Piece]:
        return [piece for piece in self.pieces if piece.kind in kinds]

    @property
    def holder(self) -> list[Piece]:
        return self.printed(HOLDER)

    @property
    def mount(self) -> list[Piece]:
        return self.printed(MOUNT)

    @property
    def clip(self) -> list[Piece]:
        return self.printed(CLIP)

    @property
    def adapter(self) -> list[Piece]:
        return self.printed(ADAPTER)

    @property
    def carriers(self) -> list[Piece]:
        """The carriers of mirrors; none if mirrors are glued to the holder."""
        return self.printed(CARRIER)

    @property
    def carrier_screws(self) -> list[Piece]:
        """Screws that pull the carriers towards the holder, and their springs."""
        return self.screws(CARRIER, HOLDER)

    @property
    def mirrors(self) -> list[Piece]:
        return self.of_kind("mirror")

    @property
    def camera(self) -> list[Piece]:
        return self.of_kind("camera")

    @property
    def threads(self) -> list[Piece]:
        """Inserts and captive nuts that are inserted before parts are joined: all except those of the back."""
        return [piece for piece in self.of_kind("insert", "nut") if piece.item is None or piece.item.size == "M3"]

    @property
    def back_nuts(self) -> list[Piece]:
        """Nuts of sizes other than M3, by which the back is fastened to its support."""
        return [piece for piece in self.of_kind("nut") if piece not in self.threads]

    @property
    def pins(self) -> list[Piece]:
        """Pins between the pieces of a split part."""
        return self.of_kind("pin")

    def threads_in(self, parts: Iterable[Piece]) -> list[Piece]:
        """The inserts and nuts whose seats are in the given parts."""
        parts = list(parts)
        return [piece for piece in self.threads if any(belongs(part, joins_of(piece)[-1]) for part in parts)]

    def screws(self, stem: str, *others: str) -> list[Piece]:
        """Screws, washers and springs that join a part to others, all given by the prefixes of their names."""
        return [
            piece
            for piece in self.of_kind("screw", "washer", "spring")
            if any(name.startswith(stem) for name in joins_of(piece))
            and any(name.startswith(others) for name in joins_of(piece))
        ]

    @property
    def holder_screws(self) -> list[Piece]:
        return self.screws(HOLDER, MOUNT)

    @property
    def camera_screws(self) -> list[Piece]:
        """Screws that join only the clip, which hold the camera."""
        return [piece for piece in self.of_kind("screw") if set(joins_of(piece)) <= {CLIP, CAMERA}]

    @property
    def clip_screws(self) -> list[Piece]:
        return self.screws(CLIP, MOUNT)

    @property
    def adapter_screws(self) -> list[Piece]:
        return self.screws(ADAPTER, ADAPTER, MOUNT)
