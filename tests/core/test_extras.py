"""A missing extra is named with the command that installs it."""

from __future__ import annotations

import pytest

from mirrorcam.core import extras
from mirrorcam.core.errors import InputError


def test_all_missing_modules_are_named_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = {"ezdxf", "mitsuba"}
    monkeypatch.setattr(extras, "find_spec", lambda module: None if module in missing else object())
    extras.require("cluster", "parquet")
    with pytest.raises(InputError, match=r'ezdxf, mitsuba not installed.*"mirrorcam\[cad,render\]"'):
        extras.require("cad", "render")
