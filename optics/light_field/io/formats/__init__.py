"""Light fields in the files of other tools; `formats.doors` has all of them by name."""
