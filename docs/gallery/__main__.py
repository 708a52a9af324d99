"""Make the gallery of devices: `python -m docs.gallery OUT`."""

import sys

from docs.gallery.make import main

if __name__ == "__main__":
    sys.exit(main())
