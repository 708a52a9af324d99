"""A desk in place of a board, with the truth of its light field."""
