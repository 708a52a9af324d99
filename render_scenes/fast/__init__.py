"""The analytic renderer, for large sets."""
