"""The error of input that cannot be used."""


class InputError(ValueError):
    """Input that cannot be used; the message says in one line what, where, and what was expected."""
