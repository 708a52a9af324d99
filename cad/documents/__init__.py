"""What people read of a device: drawings, pictures, the assembly guide and the page."""

from cad.documents.drawing import write_drawing

__all__ = ["write_drawing"]
