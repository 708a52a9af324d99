"""Values that check themselves, files written whole or not at all."""
