"""The gallery of devices, made by `python -m docs.gallery OUT`."""
