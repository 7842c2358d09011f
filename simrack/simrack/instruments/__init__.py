"""The simulated instruments, one package a model."""
