"""What a layout is worth, measured by code that the optimiser does not use."""
