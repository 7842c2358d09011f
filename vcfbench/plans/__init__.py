"""Plans: generators of frozen steps, the executor that carries them out, and what they measured."""
