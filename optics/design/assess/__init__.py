"""Assessment of layouts by code that the optimiser does not use: figures of merit, verification, tolerances."""
