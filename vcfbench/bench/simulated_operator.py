"""The operator of a simulated bench: a person's actions are done to the world, and take their time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from vcfbench.bench.bench import Bench


class _Request(Protocol):
    """A request to the operator, as :class:`vcfbench.steps.step.Request`."""

    @property
    def takes_s(self) -> float: ...

    @property
    def adjustments(self) -> Mapping[str, float | str | bool | None]: ...


def simulated_operator(bench: Bench) -> Callable[[_Request], str] | None:
    """Return the operator of a simulated `bench`, served ones too; None on a real one."""
    adjust = bench.adjust
    if adjust is None:
        return None

    def done(request: _Request) -> str:
        for name, value in request.adjustments.items():
            adjust(name, value)
        bench.clock.sleep_until(bench.clock.now() + request.takes_s)
        return "done to the simulated bench"

    return done
