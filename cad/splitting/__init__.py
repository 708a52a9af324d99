"""Parts larger than the printer's bed, cut into pieces that pins and glue join again."""
