"""The commands render and scene: synthetic frames with ground truth."""
