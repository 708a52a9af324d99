"""The error for invalid input."""


class InputError(ValueError):
    """Invalid input; the message states in one line the value, where it is, and what was expected."""
