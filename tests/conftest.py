"""What holds for all tests."""

from __future__ import annotations

import signal

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Started in the background (`make test &`), Ctrl-C is ignored; tests send it to runs, which would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
