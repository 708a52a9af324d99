"""`python -m mirrorcam`."""

import sys

from mirrorcam.cli import main

sys.exit(main())
