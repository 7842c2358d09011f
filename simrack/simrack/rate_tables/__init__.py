"""The simulated rate tables: one motion, several dialects."""
