"""The commands: each module holds one frozen options type and `run(options)`, which returns the exit code 0 or 1.

These modules are imported for `mirrorcam --help`, so that whatever is slow to import is imported inside `run`.
"""
