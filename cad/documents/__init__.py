"""What people read of a device: drawings, pictures, the assembly guide and the page."""

from cad.documents.drawing import write_drawing
from cad.documents.guide import write_guide
from cad.documents.page import write_page
from cad.documents.pictures import pictures_of, write_picture

__all__ = ["pictures_of", "write_drawing", "write_guide", "write_page", "write_picture"]
