"""The order of the steps reads like the paper's section 4.2."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.procedures.fakes import CALIBRATIONS, make_settings
from vcfbench.errors import MeasurementError, PlanError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures import turntable
from vcfbench.procedures.catalogue import PROCEDURES, procedure
from vcfbench.records.schema import Point
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import PAPER_RATES_DEG_S
from vcfbench.steps import (
    Acquire,
    AwaitRate,
    CheckRails,
    ConfigureGenerator,
    ConfigureMeter,
    ConfigureRail,
    DisableVvc,
    EnableSupply,
    EnableTable,
    EnableVvc,
    Note,
    SetRate,
    Settle,
    SetVvc,
    VerifyZero,
    Window,
)
from vcfbench.steps.dry_run import walk

if TYPE_CHECKING:
    from vcfbench.steps import Plan, Step

K_VC = 40.0


def steps_of(name: str) -> list[Step]:
    settings = make_settings(k_vc_guess_deg_s_per_v=K_VC)
    plan = PROCEDURES[name].plan(settings)
    return [each.step for each in walk(plan, LinearGyro(K_VC))]


def words(steps: list[Step]) -> list[str]:
    """Put every step in a word or two, with what matters of it."""
    said = []
    for step in steps:
        match step:
            case Note():
                said.append(f"# {step.text}")
            case SetRate():
                said.append(f"rate {step.rate_deg_s:g}")
            case SetVvc() if type(step) is SetVvc:
                said.append(f"V_Vc {step.v_vc_v:g}")
            case Settle():
                said.append(f"settle {step.seconds:g}")
            case VerifyZero():
                said.append("the zero")
            case Acquire():
                said.append(f"acquire {step.step}: {step.rate_deg_s:g} deg/s, {step.v_vc_v:g} V")
            case ConfigureRail():
                said.append(f"{step.output} {step.voltage_v:g} V {step.current_limit_a:g} A")
            case _:
                said.append(type(step).__name__)
    return said


START_UP = [
    "# Start-up",
    "ConfigureMeter",
    "DisableVvc",
    "ConfigureGenerator",
    "P25V 10 V 0.1 A",
    "N25V -10 V 0.1 A",
    "EnableSupply",
    "settle 2",
    "CheckRails",
    "ConfigureScope",
    "FindDrive",
    "MeasureDrive",
    "EnableTable",
]

THE_ZERO = ["settle 2", "the zero"]

SHUT_DOWN = [
    *("# Shut down", "rate 0", "AwaitRate", "DisableTable", "MeasureDriveAgain"),
    *("DisableVvc", "DisableSupply"),
]


def table_sweep(step: int) -> list[str]:
    points = [
        [f"rate {rate:g}", "AwaitRate", "settle 2", f"acquire {step}: {rate:g} deg/s, 0 V"]
        for rate in PAPER_RATES_DEG_S
    ]
    return [*THE_ZERO, *(line for point in points for line in point), "rate 0", "AwaitRate", *THE_ZERO]


def virtual_sweep() -> list[str]:
    points = [
        [f"V_Vc {rate / K_VC:g}", "settle 2", f"acquire 4: {rate:g} deg/s, {rate / K_VC:g} V"]
        for rate in PAPER_RATES_DEG_S
    ]
    return [line for point in points for line in point]


def test_turntable_reads_like_the_work_instruction() -> None:
    assert words(steps_of("turntable")) == [
        *START_UP,
        "# Step 1: the table turns at each rate, generator off",
        *table_sweep(1),
        *SHUT_DOWN,
    ]


def table_at(rate: float) -> list[str]:
    return [f"rate {rate:g}", "AwaitRate", "settle 2"]


def v_vc_at(volts: float) -> list[str]:
    return [f"V_Vc {volts:g}", "settle 2", f"acquire 2: 0 deg/s, {volts:g} V"]


def test_four_steps_are_in_executable_order() -> None:
    assert words(steps_of("virtual-coriolis")) == [
        *START_UP,
        "# Step 1: the table turns at 10 deg/s, generator off",
        "settle 2",
        "acquire 1: 0 deg/s, 0 V",
        *table_at(10.0),
        *["acquire 1: 10 deg/s, 0 V"] * 2,
        *table_at(0.0),
        *["acquire 1: 0 deg/s, 0 V"] * 2,
        *table_at(10.0),
        *["acquire 1: 10 deg/s, 0 V"] * 2,
        *table_at(0.0),
        "acquire 1: 0 deg/s, 0 V",
        "rate 0",
        "AwaitRate",
        "# Step 2: table at rest, generator on; V_Vc is adjusted until the output equals that of step 1",
        "V_Vc 0",
        "EnableVvc",
        "settle 2",
        "acquire 2: 0 deg/s, 0 V",
        *v_vc_at(0.25),
        *v_vc_at(0.25),
        *v_vc_at(0.0),
        *v_vc_at(0.25),
        "acquire 2: 0 deg/s, 0.25 V",
        *v_vc_at(0.0),
        "acquire 2: 0 deg/s, 0 V",
        *v_vc_at(0.25),
        "# Step 3: the table turns at each rate, generator off",
        "DisableVvc",
        *table_sweep(3),
        "# Step 4: table at rest, V_Vc stands for each rate, K_Vc = 40 (deg/s)/V",
        "V_Vc 0",
        "EnableVvc",
        *THE_ZERO,
        *virtual_sweep(),
        "V_Vc 5",
        *THE_ZERO,
        "V_Vc -5",
        *THE_ZERO,
        *SHUT_DOWN,
    ]


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_limits_are_set_before_supply_and_table(name: str) -> None:
    kinds = [type(step) for step in steps_of(name)]
    assert max(i for i, kind in enumerate(kinds) if kind is ConfigureRail) < kinds.index(EnableSupply)
    assert kinds.index(DisableVvc) < kinds.index(ConfigureGenerator) < kinds.index(EnableSupply)
    assert kinds.index(EnableSupply) < kinds.index(CheckRails) < kinds.index(EnableTable)
    assert kinds.index(ConfigureMeter) < kinds.index(Acquire)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_generator_and_table_are_never_on_together(name: str) -> None:
    on, rate = False, 0.0
    for step in steps_of(name):
        if isinstance(step, EnableVvc | DisableVvc):
            on = isinstance(step, EnableVvc)
        elif isinstance(step, SetRate):
            rate = step.rate_deg_s
        assert not (on and rate != 0.0)
        if isinstance(step, Acquire):
            assert on == (step.step in {2, 4})
            assert step.table_deg_s == rate


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_window_comes_two_seconds_after_the_last_change(name: str) -> None:
    settled_s = 0.0
    for step in steps_of(name):
        if isinstance(step, Settle):
            settled_s += step.seconds
        elif isinstance(step, Acquire):
            assert settled_s >= 2.0
        elif isinstance(step, SetRate | SetVvc | AwaitRate | EnableVvc | DisableVvc):
            settled_s = 0.0


ON_TABLE: dict[str, Any] = {"by": "table", "settle_s": 3.0}
EVERY: list[tuple[str, dict[str, Any]]] = [
    *((name, {"k_vc": "150"} if name in {"self-calibration", "online"} else {}) for name in BUILT_IN),
    *((name, ON_TABLE) for name in ("power", "repeatability", "rate-limits", "temperature")),
]


@pytest.mark.parametrize(("name", "settings"), few([each for each in EVERY if each[0] != "characterize"], every=3))
def test_each_step_is_told_what_those_before_it_have_set(name: str, settings: dict[str, Any]) -> None:
    """Ramps begin at the rate before, windows are of the rate and V_Vc that are on, after a change that has settled."""
    rate_deg_s = ramp_s = acceleration_deg_s2 = v_vc_v = settled_s = 0.0
    on, shut_down = False, False
    for step in (each.step for each in vcfbench.dry_run(name, "lab", settings=settings).steps):
        match step:
            case Note(text=text):
                shut_down = text == "Shut down"
            case EnableTable():
                shut_down = False
            case SetRate(acceleration_deg_s2=acceleration_deg_s2):
                ramp_s = abs(step.rate_deg_s - rate_deg_s) / acceleration_deg_s2
                assert step.previous_deg_s == (0.0 if shut_down else rate_deg_s)  # from whatever rate it has
                rate_deg_s = step.rate_deg_s
            case AwaitRate():
                assert step.rate_deg_s == rate_deg_s
                assert step.ramp_s == (0.0 if shut_down else ramp_s)
                assert step.deadline_s >= 2.0 * ramp_s
            case EnableVvc() | DisableVvc():
                on = isinstance(step, EnableVvc)
            case SetVvc():
                v_vc_v = step.v_vc_v
            case Acquire():
                assert step.v_vc_v == v_vc_v * on
                assert step.table_deg_s in {None, rate_deg_s}
                assert step.rate_deg_s * rate_deg_s >= 0.0
                assert settled_s >= settings.get("settle_s", 2.0) or name == "warmup"
        if isinstance(step, SetRate | SetVvc | AwaitRate | EnableVvc | DisableVvc | ConfigureRail):
            settled_s = 0.0
        settled_s += step.seconds if isinstance(step, Settle) else 0.0


def test_loose_lead_ends_sweep_at_first_pair_of_rates() -> None:
    gyro, taken = LinearGyro(K_VC), list[float]()
    earlier = [Point(1, rate, 0.0, gyro.scale_factor * rate, 1e-5, 10) for rate in (0.0, 10.0)]

    def done(sweep: Plan) -> None:
        step = next(sweep)
        while True:
            result = step.predict(gyro)
            if isinstance(result, Window) and result.point.step == 3:
                taken.append(result.point.rate_deg_s)
                output_v = result.point.output_v if len(taken) == 1 else 0.0
                result = structs.replace(result, point=structs.replace(result.point, output_v=output_v))
            step = sweep.send(result)

    with pytest.raises(MeasurementError, match="a lead is off"):
        done(turntable.table_sweep(make_settings(k_vc_guess_deg_s_per_v=K_VC), 3, earlier))
    assert taken == [0.0, 200.0, 100.0]


def test_keys_name_steps_by_their_parameters() -> None:
    first, second = steps_of("virtual-coriolis"), steps_of("virtual-coriolis")
    assert [step.key for step in first] == [step.key for step in second]
    assert SetVvc(0.1).key != SetVvc(0.2).key


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_step_says_what_it_does(name: str) -> None:
    for step in steps_of(name):
        assert step.describe()
        assert step.duration_s >= step.physical_s >= 0.0


@pytest.mark.parametrize("name", ["self-calibration", "kvc", "repeatability", "power", "phase"])
def test_what_is_done_again_and_again_is_counted_from_1(name: str) -> None:
    settings = {"self-calibration": {"k_vc": "150", "cycles": 3}}.get(name, {})
    notes = list(map(str, vcfbench.dry_run(name, "lab", settings=settings).steps))
    counted = [int(found[1]) for each in notes if (found := re.search(r"(?:[Cc]ycle|Switch-on) (-?\d+)", each))]
    assert sorted(set(counted)) == list(range(1, max(counted) + 1))
    assert counted[0] == 1


def test_an_unknown_procedure_is_answered_with_the_known_ones() -> None:
    with pytest.raises(PlanError, match="no procedure 'spin'; known are turntable, virtual-coriolis"):
        procedure("spin")
