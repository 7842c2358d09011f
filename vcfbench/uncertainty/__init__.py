"""What a value is uncertain by: sources, budgets of lines and of outputs at rest, windows and their noise."""
