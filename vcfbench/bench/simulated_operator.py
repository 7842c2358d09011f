"""The operator of a simulated bench: what a person would do is done to the world, and takes its time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from vcfbench.bench.bench import Bench


class _Request(Protocol):
    """What is asked for, as :class:`vcfbench.plans.step.Request` says it."""

    @property
    def takes_s(self) -> float: ...

    @property
    def adjustments(self) -> Mapping[str, float | str | bool | None]: ...


def simulated_operator(bench: Bench) -> Callable[[_Request], str] | None:
    """Return who does what is asked for on a simulated `bench`, served ones too; None on a real one."""
    adjust = bench.adjust
    if adjust is None:
        return None

    def done(request: _Request) -> str:
        for name, value in request.adjustments.items():
            adjust(name, value)
        bench.clock.sleep_until(bench.clock.now() + request.takes_s)
        return "done to the simulated bench"

    return done
