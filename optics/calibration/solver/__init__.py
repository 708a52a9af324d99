"""From corners to a camera: the model, its derivatives, and the solver."""
