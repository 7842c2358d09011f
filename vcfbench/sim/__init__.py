"""The simulated bench: one physical world and the instruments that look at it."""
