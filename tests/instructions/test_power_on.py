"""After power-on, rails and drive are looked at before a long wait, in every procedure and when a run is resumed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

from vcfbench.cli.set_option import asked_by_command
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.station.file import embedded_text
from vcfbench.steps import CheckRails, DisableSupply, EnableSupply, MeasureDrive, Settle, Step
from vcfbench.steps.dry_run import walk
from vcfbench.steps.replay import start_up_again
from vcfbench.steps.step import Effect

if TYPE_CHECKING:
    from collections.abc import Iterable

    from vcfbench.station.settings import ProcedureSettings
    from vcfbench.steps import Plan

NEEDED = {name: ['k_vc="150"'] for name in ("online", "self-calibration")}
LONG_S = 60.0


def asked(name: str, *values: str) -> ProcedureSettings:
    lab = parse_bench(embedded_text("lab"), "lab.toml")
    return settings_of(PROCEDURES[name], lab, asked_by_command([*NEEDED.get(name, []), *values], {}, {}))


def steps_of(plan: Plan, settings: ProcedureSettings) -> list[Step]:
    return [each.step for each in walk(plan, settings.expected_gyro())]


def unseen_waits_s(steps: Iterable[Step], kind: type[Step]) -> list[float]:
    """Return the long waits since power-on that no check of a kind came before, s."""
    found, on, seen = [], False, True
    for step in steps:
        if EnableSupply.subject in step.sets:
            on, seen = not isinstance(step, DisableSupply), False
        seen = seen or isinstance(step, kind)
        if on and not seen and isinstance(step, Settle) and step.seconds > LONG_S:
            found.append(step.seconds)
    return found


def waited_s(steps: Iterable[Step]) -> float:
    return sum(step.seconds for step in steps if isinstance(step, Settle))


@pytest.mark.parametrize("name", few(sorted(set(PROCEDURES) - {"electrical"}), every=4))
def test_rails_and_drive_are_seen_before_a_long_wait(name: str) -> None:
    settings = asked(name)
    steps = steps_of(PROCEDURES[name].plan(settings), settings)
    assert any(EnableSupply.subject in step.sets for step in steps)
    assert unseen_waits_s(steps, CheckRails) == []
    assert unseen_waits_s(steps, MeasureDrive) == []


@pytest.mark.parametrize("name", sorted(set(PROCEDURES) - {"electrical", "warmup", "characterize"}))
def test_a_run_that_stops_before_its_first_reading_is_resumed_as_warm(name: str) -> None:
    settings = asked(name, "powered_s=600" if name == "zero" else "warm_up_s=600")
    steps = steps_of(PROCEDURES[name].plan(settings), settings)
    taken = steps[: next(number for number, step in enumerate(steps) if step.effect is Effect.MEASURES)]
    again = steps_of(start_up_again(taken, settings), settings)
    assert unseen_waits_s(again, MeasureDrive) == []
    assert 0.98 * min(settings.warm_again_s, waited_s(taken)) < waited_s(again) < 1.02 * waited_s(taken)
