"""The assembled device: the plan of every part, its pieces, its purchased items."""
