"""The flat mirrors for a laser cutter: nested on sheets, as DXF and SVG."""
