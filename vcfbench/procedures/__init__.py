"""Procedures: generators of frozen steps, and the executor that carries them out."""
