"""A value with its uncertainty: quantiles, verdict, names and printing. Nothing here imports anything but errors."""
