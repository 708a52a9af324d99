"""The exports of a device, as the tests of their readers have them."""

from tests.optics.camera_files.read.conftest import exported as exported
