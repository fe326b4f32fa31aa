"""Launcher: becomes the planner's command, in the surroundings that it gets: its pipes and nothing else of ours.

Run as a script, without any import of the package, by `process.PlannerProcess`:
python -I -S launcher.py REQUESTS REPLIES MEMORY_BYTES PARENT COMMAND...
"""

import ctypes
import fcntl
import os
import resource
import signal
import sys
from contextlib import suppress

REQUESTS, REPLIES = 3, 4
"""Where every planner finds its pipes."""


def main() -> None:
    """Never returns."""
    requests, replies, memory_bytes, parent = map(int, sys.argv[1:5])
    command = sys.argv[5:]
    os.setpgid(0, 0)  # all that it starts can be ended at once
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            os._exit(1)
        with suppress(OSError), open("/proc/self/oom_score_adj", "w") as score:
            score.write("500")  # where memory runs out it goes first, and not who drives
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    if memory_bytes:
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, set())
    above = [fcntl.fcntl(each, fcntl.F_DUPFD, 10) for each in (requests, replies)]
    for each, place in zip(above, (REQUESTS, REPLIES), strict=True):
        os.dup2(each, place)
    os.closerange(REPLIES + 1, max(*above, requests, replies) + 1)
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.exit(f"cannot start {command[0]}: {error.strerror}")


if __name__ == "__main__":
    main()
