"""Errors that an error came of, whether raised from them or while they were handled."""

from __future__ import annotations

from mirrorcam.core.causes import causes


def test_errors_come_of_those_raised_from_and_those_being_handled() -> None:
    try:
        try:
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt:
                raise ImportError("half loaded")  # noqa: B904
        except ImportError as error:
            raise RuntimeError("no loop") from error
    except RuntimeError as error:
        assert [type(each) for each in causes(error)] == [RuntimeError, ImportError, KeyboardInterrupt]
