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
_NO_NEW_PRIVS = 38
_CREATE_RULESET, _RESTRICT_SELF = 444, 446
_NO_BLOCK_DEVICES, _SCOPED_SIGNALS = 1 << 11, 2


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
    if command[0] == sys.executable:  # a program of the user's own may need rights that this takes: sudo
        _confine()
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.exit(f"cannot start {command[0]}: {error.strerror}")


def _confine() -> None:
    """Keep it, and all that it starts, from the memory of all other processes, and from signals to them.

    By Landlock: who is in a domain may trace nobody outside of it (Linux 5.13; a domain needs something that it
    forbids, here what nobody does), and a domain may scope signals (Linux 6.12). Other systems leave all as it is.
    """
    if sys.platform != "linux":
        return
    libc = ctypes.CDLL(None)
    files, ports, scopes = (each.to_bytes(8, sys.byteorder) for each in (_NO_BLOCK_DEVICES, 0, _SCOPED_SIGNALS))
    for forbidden in (files + ports + scopes, files):
        ruleset = libc.syscall(_CREATE_RULESET, forbidden, ctypes.c_size_t(len(forbidden)), 0)
        if ruleset >= 0:
            libc.prctl(_NO_NEW_PRIVS, 1, 0, 0, 0)
            libc.syscall(_RESTRICT_SELF, ruleset, 0)
            os.close(ruleset)
            return


if __name__ == "__main__":
    main()
