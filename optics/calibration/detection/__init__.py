"""Detection of a board's corners in pictures, through mirrors or directly."""
