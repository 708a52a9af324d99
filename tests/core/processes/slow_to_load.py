"""A module that takes forever to load, in the process whose number it notes."""

import os
import time
from pathlib import Path

if "SLOW_TO_LOAD" in os.environ:
    Path(os.environ["SLOW_TO_LOAD"]).write_text(f"{os.getpid()}\n")
    time.sleep(300)
