"""From pictures to corners: where a target is seen, through mirrors or directly."""
