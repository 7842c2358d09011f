"""The tests of the rack. How long an example takes is the machine's affair and no failure."""

import os

from hypothesis import settings

settings.register_profile("any machine", deadline=None, max_examples=10)
settings.register_profile("ci", deadline=None, max_examples=25)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "any machine"))
