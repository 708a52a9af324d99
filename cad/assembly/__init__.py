"""The assembled device: the plan of every part, its pieces, its bought items."""
