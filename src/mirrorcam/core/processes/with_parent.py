"""Import this in a process to have it killed when the process that started it ends, on Linux.

The fork server of `worker_process` imports it first: it loads slow libraries next, and watches for the end of its
parent only after that.
"""

import ctypes
import signal
import sys

PR_SET_PDEATHSIG = 1

if sys.platform == "linux":
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
