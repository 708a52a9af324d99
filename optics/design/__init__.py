"""Design of a layout: seeds, metrics, optimiser."""
