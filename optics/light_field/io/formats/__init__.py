"""File formats of light fields: each module here except `registry` defines one, of its own name, as `FORMAT`."""
