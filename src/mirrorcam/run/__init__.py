"""The commands run, from design to depth, and doctor, which checks the installation."""
