"""Light fields: from frames to views, depth, refocused pictures, features and trajectories."""
