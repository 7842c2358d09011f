"""Studies: many runs of one procedure on simulated benches, and what their results come to."""
