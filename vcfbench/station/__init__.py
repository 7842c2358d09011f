"""The station: bench file, limits, wiring, identity of instruments, discovery, a file for a new one."""
