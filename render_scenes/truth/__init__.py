"""What pictures truly show: float64, and no renderer."""
