"""The commands render, scene and picture: frames with known truth."""
