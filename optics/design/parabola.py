"""The faceted parabola of a specification with its figures, to compare an optimised layout with."""

from __future__ import annotations

from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout


def assessed_parabola(spec: DesignSpec) -> Layout:
    """The faceted parabola of a specification, with its metrics and the verdict on it, which may fail.

    Raises InputError where the specification has none, or a working depth is nearer than its mirrors.
    """
    layout = faceted_parabola(spec)
    return layout.replaced(spec=spec, metrics=evaluate(layout, spec.depths_mm), verdict=verify(layout, spec))
