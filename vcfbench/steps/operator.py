"""Manual steps: a request to a person, for whom the run waits."""

from typing import ClassVar

from msgspec import Struct

from vcfbench.bench.bench import Bench
from vcfbench.interfaces import Operator, Request
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Effect, Step, StepResult, does

_NAMES = {"v_vc": "V_Vc input", "rail_positive": "positive rail", "rail_negative": "negative rail"}


class OperatorAnswer(StepResult, Struct, frozen=True):
    """Answer of the person when it was done."""

    answer: str

    def describe(self) -> str:
        return self.answer or "done"


@does(Effect.SETS, "what hands do")
class AskOperator(Step, Struct, frozen=True):
    """Ask a person to do something, in words that follow "please": ``move the leads ...``; wait until it is done.

    `takes_s` is the estimate of how long that takes. `adjustments` are names and values that come to the same on a
    simulated bench, as ``vcfbench sim ctl set`` takes them: there the world is changed, and the time passes.
    """

    waits_for_person: ClassVar[bool] = True

    words: str
    takes_s: float = 60.0
    adjustments: tuple[tuple[str, float | str | bool | None], ...] = ()

    @property
    def sets(self) -> tuple[str, ...]:
        """Names of the adjustments; without any, the words, so that no other request undoes this one."""
        return tuple(f"{self.subject}: {name}" for name, _ in self.adjustments) or (f"{self.subject}: {self.words}",)

    def describe(self) -> str:
        return f"by hand: {self.words}"

    def perform(self, context: Context) -> OperatorAnswer:
        """Ask, and wait; PlanError without an operator."""
        return OperatorAnswer(context.operator(Request(self.words, self.takes_s, dict(self.adjustments))))

    def predict(self, gyro: LinearGyro) -> OperatorAnswer:
        return OperatorAnswer("done")

    @property
    def duration_s(self) -> float:
        return self.takes_s


def move_leads(meter: str, node: str) -> AskOperator:
    """Return the step that has the leads of `meter`, a role, put on `node` of the PCB."""
    words = f"move the leads of the {meter.replace('_', ' ')} to the {_NAMES.get(node, node)}"
    return AskOperator(words, adjustments=((f"{meter}.input.node", node),))


def simulated_operator(bench: Bench) -> Operator | None:
    """Return the operator of a simulated `bench`, served ones too; None on a real one.

    A person's actions are done to the world, and take their time.
    """
    adjust = bench.adjust
    if adjust is None:
        return None

    def done(request: Request) -> str:
        for name, value in request.adjustments.items():
            adjust(name, value)
        bench.clock.sleep_until(bench.clock.now() + request.takes_s)
        return "done to the simulated bench"

    return done
