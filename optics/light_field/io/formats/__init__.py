"""File formats of light fields: each module here but `registry` is one, under its own name, and has it as `FORMAT`."""
