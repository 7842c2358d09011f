"""The kit that somebody runs at his own instruments, and what comes of what it records."""
