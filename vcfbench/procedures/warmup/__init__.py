"""Warm-up: the output at rest from power-on until it is steady."""
