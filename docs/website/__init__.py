"""The documentation site: `python -m docs.website OUT` in the root of the repository builds it (extra `docs`)."""
