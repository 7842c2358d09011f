"""The command line, one module per command group."""

import gc

# What a command loads stays; at Python's pace looking through it for garbage takes a tenth of a short run, some of it
# before the first command group is there. A short run stays below this.
gc.set_threshold(200_000)
