"""The layout with the mirrors that moved where a recording shows them."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.calibration.diagnostics.calibration_result import moved_to
from mirrorcam.optics.drift.drift import Drift
from mirrorcam.optics.drift.mirror_motions import mirror_rows
from mirrorcam.optics.geometry.layout import Layout, Uncertainty


def resolved_layout(layout: Layout, drift: Drift, source: str) -> Layout:
    """The layout with the moved mirrors at their new planes, with the covariance of those, and what it is from.

    Mirrors that did not move, and the camera, stay as calibrated. `source` says what the recording is.
    """
    mirrors = list(layout.mirrors)
    for move in drift.moved:
        mirror = mirrors[move.index]
        change = drift.change[mirror_rows(drift.names, move.index)]
        mirrors[move.index] = moved_to(mirror, mirror.virtual_centre_in_rig_mm + change)
    moved = ", ".join(layout.mirror_names[move.index] for move in drift.moved)
    return layout.replaced(
        mirrors=tuple(mirrors),
        metrics={},
        verdict={},
        uncertainty=_uncertainty(layout, drift),
        provenance=layout.provenance
        | {"resolved_from": layout.identity, "resolved_mirrors": moved, "resolved_by": source},
    )


def _uncertainty(layout: Layout, drift: Drift) -> Uncertainty | None:
    """The covariance of the calibrated parameters, that of the moved mirrors anew; None where there was none."""
    known = layout.uncertainty
    if known is None:
        return None
    places = [(place, drift.names.index(name)) for place, name in enumerate(known.parameters) if name in drift.names]
    rows, columns = np.array(places, dtype=np.int64).T
    covariance = known.covariance.copy()
    covariance[np.ix_(rows, rows)] = drift.covariance[np.ix_(columns, columns)]
    return Uncertainty(parameters=known.parameters, covariance=(covariance + covariance.T) / 2.0)
