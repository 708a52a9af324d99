"""Behaviour with bad input: damaged and hostile files of every kind.

`python -m benchmarks.robustness [CATEGORY ...] [--part 0.01] [--seed 0]` prints counts of attempts, right and wrong.
"""
