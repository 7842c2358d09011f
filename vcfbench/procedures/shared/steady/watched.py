"""A part of a plan whose windows are seen as they are taken, and asked together at its end."""

from typing import TypeVar

from vcfbench.procedures.shared.steady.jumps import require_no_jump
from vcfbench.procedures.shared.steady.walk import Limits, Walk
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.step import Routine

T = TypeVar("T")


def watched(settings: ProcedureSettings, work: Routine[T]) -> Routine[T]:
    """Do `work`, see each of its windows, and see at its end that the output stood still and answered.

    MeasurementError: a setting did not give what it gave before, there was a step, a pulse or a walk of the output, or
    the output did not answer to what was set.
    """
    walk = Walk(settings, Limits.of(settings))
    try:
        step = next(work)
        while True:
            try:
                result = yield step
                walk.note(step, result)
            except BaseException as error:  # noqa: BLE001 - whatever it is, it is the work's to deal with
                step = work.throw(error)
            else:
                step = work.send(result)
    except StopIteration as ended:
        done: T = ended.value
    if walk.measured:
        require_no_jump(walk)
    return done
