"""Quick pictures of what a layout sees, traced by loops in machine code: for interactive design."""
