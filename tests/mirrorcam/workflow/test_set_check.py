"""A set passes its check only where every file is there and as it was rendered."""

from __future__ import annotations

import pytest

from mirrorcam.workflow.set_check import SetCheck


@pytest.mark.parametrize(
    ("altered", "lost", "unfinished", "passed"),
    [((), (), (), True), (("a",), (), (), False), ((), ("a",), (), False), ((), (), ("a",), False)],
)
def test_any_file_that_is_not_right_fails_the_check(
    altered: tuple[str, ...], lost: tuple[str, ...], unfinished: tuple[str, ...], passed: bool
) -> None:
    assert SetCheck(3, altered, lost, unfinished).passed == passed
