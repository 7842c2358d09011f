"""Procedures: what is calibrated, in which order, and what comes of it."""
