"""The nonlinear program of a design, and its seeds."""
