"""Safety: stack of safe actions, lock, signals, control of a run, watchdog."""
