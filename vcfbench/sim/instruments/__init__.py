"""The simulated instruments, one file a model."""
