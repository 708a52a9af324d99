"""Documents of a device: drawings, pictures, the assembly guide and the page."""

from mirrorcam.cad.guide.assembly_guide import write_guide
from mirrorcam.cad.guide.device_page import write_page
from mirrorcam.cad.guide.device_pictures import pictures_of
from mirrorcam.cad.guide.drawing import write_drawing
from mirrorcam.cad.guide.picture_views import write_picture

__all__ = ["pictures_of", "write_drawing", "write_guide", "write_page", "write_picture"]
