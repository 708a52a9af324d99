"""On Linux, a process that imports this module is killed when its parent ends.

The fork server of `worker_process` imports it first, because it watches for the end of its parent only after it has
loaded slow libraries.
"""

import ctypes
import signal
import sys

PR_SET_PDEATHSIG = 1

if sys.platform == "linux":
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
