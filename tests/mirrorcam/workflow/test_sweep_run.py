"""The designs of a sweep, by processes of this machine: in groups that share what was built for one of them."""

from __future__ import annotations

from mirrorcam.optics.base.worker_pool import Died
from mirrorcam.optics.design.spec_grid import structure
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.workflow.sweep_run import design_here, in_order
from mirrorcam.workflow.sweep_work import Answer


def scale_of(spec_json: str) -> Answer:
    return Answer(f"{DesignSpec.model_validate_json(spec_json).scale_mm:g}")


def test_answers_come_with_the_number_of_their_spec() -> None:
    specs = [DesignSpec(rows=rows, scale_mm=40.0 + number) for number, rows in enumerate((2, 3, 2))]
    answers: dict[int, Answer | Died] = dict(design_here(specs, 2, scale_of))
    assert answers == {number: Answer(f"{40 + number}") for number in range(3)}


def test_specs_of_one_structure_follow_each_other_and_the_largest_arrays_come_first() -> None:
    counts = [(2, 2), (3, 3), (2, 2), (1, 2), (3, 3)]
    specs = [DesignSpec(rows=rows, cols=cols, scale_mm=60.0 + n) for n, (rows, cols) in enumerate(counts)]
    specs.append(specs[1].replaced(depths_mm=(400.0,)))
    groups = in_order(specs)
    assert groups == [[1, 4], [5], [0, 2], [3]]
    assert all(len({structure(specs[number]) for number in group}) == 1 for group in groups)
