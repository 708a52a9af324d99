"""What a record of a sweep says it was made with: everything that decides about a design."""

from __future__ import annotations

from importlib import metadata

import pytest

from mirrorcam.core.disk.fingerprint import differing
from mirrorcam.designs import sweep_work


@pytest.fixture(scope="module")
def made_with() -> dict[str, str]:
    return sweep_work.made_with()


def test_another_version_of_a_library_makes_other_designs(
    made_with: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: "999" if name == "casadi" else now(name))
    assert differing(made_with, sweep_work.made_with.__wrapped__()) == ["casadi"]


def test_only_sources_that_decide_about_designs_are_recorded(made_with: dict[str, str]) -> None:
    assert {"mirrorcam.optics.design", "mirrorcam.optics.geometry"} <= made_with.keys()
    assert not {f"mirrorcam.optics.{name}" for name in sweep_work.UNRELATED} & made_with.keys()
