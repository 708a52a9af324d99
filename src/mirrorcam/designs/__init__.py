"""The commands design and sweep: requests, files, figures and report of a layout."""
