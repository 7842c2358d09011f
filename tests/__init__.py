"""The tests. How long an example takes, and what a shell makes of signals, is the machine's affair and no failure."""

import os
import signal

from hypothesis import settings

# The matrices are small: a second thread of the linear algebra only waits, and does that busily.
# It is read when numpy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

settings.register_profile("any machine", deadline=None, max_examples=10)
settings.register_profile("ci", deadline=None, max_examples=25)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "any machine"))

# A shell without job control has its background jobs ignore SIGINT, nohup SIGHUP, and children inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
