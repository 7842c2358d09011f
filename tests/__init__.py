"""The tests. How long an example takes is the machine's affair, and no failure."""

from hypothesis import settings

settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")
