"""The device put together: the plan of every part, its pieces, its bought items."""
