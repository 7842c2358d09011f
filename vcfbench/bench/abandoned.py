"""A bench that its program has left live, by its death or because it hung, made safe as soon as its locks are free."""

from typing import Any, Final

from vcfbench.bench.make_safe import MadeSafe, safe_bench
from vcfbench.clock import WallClock, sleep
from vcfbench.errors import ConnectFailed
from vcfbench.safety.lock import InUse
from vcfbench.safety.processes import dying, mark_of
from vcfbench.station.description import BenchDescription
from vcfbench.typed import typed

_LOOK_S: Final = 0.1
_FREED_S: Final = 5.0
"""Longest time until the locks of a program that has just died are free, s."""
_OTHERS_S: Final = 30.0
"""For how long it waits for another process that has the bench: longer than a `safe` takes, which may die too."""


def safe_abandoned(charge: dict[str, Any], *, left: bool) -> MadeSafe:
    """Make the bench of a `charge` safe: the description, the process that had it and the mark of that.

    `left`: the program lives on without it. A bench that another run has taken over is left to that; locks left by a
    dead one drive nothing.

    Raises:
        InUse: somebody else has it, and may drive something.
        BenchError: as of :func:`safe_bench`.
    """
    description = typed(charge["bench"], BenchDescription)
    clock = WallClock()
    while not left and _lives(charge) and dying(charge["owner"]) and clock.now() < _FREED_S:
        sleep(clock, _LOOK_S)  # as it dies it gives its locks back one by one, and then its wires
    while True:
        try:
            done = safe_bench(description)
            owner = charge["owner"]
            own = [each for each in done.left_to.values() if each.owner is not None and each.owner.pid == owner]
            if left or not own:
                return done
            error, taken, alone = own[0], False, len(own) == len(done.left_to)
            longest_s = _OTHERS_S  # what was free is safe
        except InUse as refused:
            error, alone = refused, True
            taken = refused.owner is not None and refused.owner.pid != charge["owner"]
            longest_s = _OTHERS_S if taken else _FREED_S
        except ConnectFailed:
            if clock.now() > _FREED_S:
                raise
            error = None
        if error is not None and clock.now() > longest_s:
            if taken:
                return MadeSafe((), (), left_to={"all": error})
            if alone and not _lives(charge):
                return safe_bench(description, force=True)
            raise error
        sleep(clock, _LOOK_S)


def _lives(charge: dict[str, Any]) -> bool:
    return bool(mark_of(charge["owner"]) == charge["mark"])
