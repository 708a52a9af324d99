"""The device put together: every part's plan, its pieces, what is bought."""
