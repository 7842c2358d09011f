"""Judges the messages that a person types at an instrument: none may leave the limits of the bench.

Settings of levels, rates and accelerations are understood in the instrument's own words and compared with the bench
file's ``[limits]``, together with what the instrument says of its present settings: a level that an earlier program
left counts when an output is switched on. What could move or energise something and is not understood is refused as
well, because the limits are there for whoever stands beside the table, not for whoever types.
"""

from vcfbench.bench.guard.judge import Ask, Guard, guard_of

__all__ = ["Ask", "Guard", "guard_of"]
