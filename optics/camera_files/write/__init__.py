"""Writers of a calibrated layout in the formats of other tools, each mirror as a separate camera."""

from mirrorcam.optics.camera_files.write.virtual_cameras import VirtualCamera, virtual_cameras
from mirrorcam.optics.camera_files.write.write_exports import write_exports

__all__ = ["VirtualCamera", "virtual_cameras", "write_exports"]
