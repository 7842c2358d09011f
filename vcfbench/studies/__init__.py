"""Studies: many runs of one procedure on simulated benches, and their statistics."""
