"""The commands render and scene: frames with known truth."""
