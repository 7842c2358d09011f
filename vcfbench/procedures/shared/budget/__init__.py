"""Uncertainty budgets of a line of outputs against rates."""
