"""Procedures: quantities to calibrate, the order of their steps, and their results."""
