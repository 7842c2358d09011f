"""The bench: file, description, opening, safety."""
