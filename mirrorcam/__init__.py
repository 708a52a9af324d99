"""The mirrorcam command and the pipeline that chains the rooms."""
