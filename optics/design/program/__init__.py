"""The nonlinear program that a design solves, and where it starts."""
