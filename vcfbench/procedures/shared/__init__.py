"""Common parts of procedures: routines, sweeps, budgets, values known beforehand, checks of steadiness."""
