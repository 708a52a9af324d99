"""Design of layouts: the optimiser (`program`), and independent figures of merit and verification (`assess`)."""
