"""What a person at a terminal sees of long work, and how they interrupt it."""
