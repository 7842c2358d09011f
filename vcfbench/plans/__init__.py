"""Plans: generators of frozen steps, their executor, and the measured points and results."""
