"""Detection of a target's corners in pictures, through mirrors or directly."""
