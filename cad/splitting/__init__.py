"""Splitting of parts larger than the printer's bed, into pieces that pins and glue join again."""
