"""A mark for tests that read files in FreeCAD."""

from __future__ import annotations

import pytest

from tests.cad.write.freecad import find_freecad

NEEDS_FREECAD = pytest.mark.skipif(find_freecad() is None, reason="FreeCAD is not installed: no freecadcmd")
