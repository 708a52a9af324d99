"""The flat mirrors as a laser cutter takes them: nested on sheets, as DXF and SVG."""
