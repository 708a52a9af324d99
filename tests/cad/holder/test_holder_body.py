"""The body of a holder: only pads are in the pockets of their mirrors; InputError for a body in pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.holder_body import body_of, one_piece
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.core.errors import InputError


def test_only_pads_extend_into_pockets(device: Device) -> None:
    plan = device.holder
    room = Manifold.batch_hull(
        [Manifold.hull_points(np.vstack([group[0].base, group[0].top])) for group in plan.keep_outs[:1]]
    )
    bare = body_of(PlanarCsg(), replace(plan, pads=()))
    assert (bare ^ room).volume() == pytest.approx(0.0, abs=1e-6)
    pads = sum((Manifold.hull_points(np.vstack([pad.base, pad.top])) ^ room).volume() for pad in plan.pads[:3])
    assert pads > 1.0
    assert (body_of(PlanarCsg(), plan) ^ room).volume() == pytest.approx(pads, rel=1e-9)


def test_a_body_in_two_pieces_is_refused() -> None:
    cube = Manifold.cube((5.0, 5.0, 5.0))
    crumb = Manifold.cube((0.5, 0.5, 0.5)).translate((20.0, 0.0, 0.0))
    assert one_piece(cube + crumb, 1.2).volume() == pytest.approx(125.0)
    with pytest.raises(InputError, match="falls apart into 2 pieces where the light passes"):
        one_piece(cube + cube.translate((20.0, 0.0, 0.0)), 1.2)
