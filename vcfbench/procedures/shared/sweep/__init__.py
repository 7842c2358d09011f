"""A sweep over rates: the order of its points, their agreement, and the noise of its windows."""
