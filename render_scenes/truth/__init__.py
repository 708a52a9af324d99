"""Ground truth of rendered pictures: ray tracing in float64, without a renderer."""
