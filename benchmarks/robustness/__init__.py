"""What comes of bad input: damaged files of every kind, options out of range, and processes that are killed.

`python -m benchmarks.robustness [CATEGORY ...] [--part 0.01] [--seed 0]` prints tried, right, wrong.
"""
