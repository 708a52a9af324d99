"""The package of ROS 2, as Python finds it in a workspace."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.test_architecture import ROOT


@pytest.fixture(autouse=True)
def workspace(monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the package, on the path, and none of its modules left from a test before."""
    pytest.importorskip("rosbags", reason="needs rosbags, of the extra robot, for the definitions of messages")
    for name in [name for name in sys.modules if name.partition(".")[0] == "mirrorcam_ros"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(ROOT / "ros2"))
    return ROOT / "ros2"
