"""Documents of a device: drawings, pictures, the assembly guide and the page."""

from mirrorcam.cad.documents.assembly_guide import write_guide
from mirrorcam.cad.documents.device_page import write_page
from mirrorcam.cad.documents.device_pictures import pictures_of
from mirrorcam.cad.documents.drawing import write_drawing
from mirrorcam.cad.documents.picture_views import write_picture

__all__ = ["pictures_of", "write_drawing", "write_guide", "write_page", "write_picture"]
