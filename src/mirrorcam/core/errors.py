"""The error for invalid input."""


class InputError(ValueError):
    """Invalid input; the message states in one line the value, its place, and what was expected."""
