"""Labels and number formats of figures and pages."""
