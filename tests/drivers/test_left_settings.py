"""What a last user has left: with each other value of each setting a driver is right, or refuses it by its name."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from msgspec.structs import replace
from simrack.sources import Drive

from tests.cells import few
from tests.drivers.boxes import GENERATORS, INPUT_V, METERS, SCOPES, SINE, SUPPLIES, box
from tests.drivers.left_cells import CELLS, CLIPPED, OF_GENERATORS, OF_SCOPES, OF_SUPPLIES, Left, left
from vcfbench.clock import sleep
from vcfbench.drivers.agilent33220a import Agilent33220A
from vcfbench.drivers.dso7104b import Dso7104B
from vcfbench.drivers.e36312a import E36312A
from vcfbench.errors import BenchError, InstrumentError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tests.drivers.boxes import Box


def disturbing(cells: Iterable[tuple[str, Left]]) -> list[Any]:
    """Return the cells that change something here, one of each model for every run of the tests."""
    moved = [each for each in cells if not each[1].idle]
    return few(moved, *{model: (model, cell) for model, cell in reversed(moved)}.values())


def leave(of: Box, cell: Left) -> None:
    for words in cell.words:
        if words == "REAR":
            of.device.rear = True  # type: ignore[attr-defined]
        elif words == "60 HZ":
            of.device.line_hz = 60  # type: ignore[attr-defined]
        else:
            of.say(words)


def read(meter: Any) -> list[float]:
    """Take single readings, then a burst, at its first try."""
    meter.configure_dc_voltage(10.0, 1.0)
    single_v = [meter.read_voltage_v() for _ in range(3)]
    lasts_s = meter.start_sampling(20, 0.05)
    sleep(meter.clock, lasts_s)
    return [*single_v, *meter.sampled_voltages_v()]


def is_right(of: Box, cell: Left) -> bool:
    """Tell whether the readings are the input's; one that is refused by its name counts."""
    leave(of, cell)
    with of.driven(mains_hz=50.0) as meter:
        try:
            readings_v = read(meter)
        except InstrumentError as error:
            return bool(cell.named) and cell.named in str(error)
    return not cell.named and all(abs(each - INPUT_V) < 1e-4 for each in readings_v)


@pytest.mark.parametrize(
    ("model", "cell"), few(CELLS, every=5), ids=lambda each: each if isinstance(each, str) else each.words[0]
)
def test_a_meter_is_right_whatever_was_left(model: str, cell: Left) -> None:
    assert is_right(box(model), cell)


@pytest.mark.parametrize(
    ("model", "cell"),
    disturbing(CELLS),
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_what_is_left_is_seen_without_the_table(model: str, cell: Left, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a setting that changes nothing here the test above could not fail."""
    of = box(model)
    leave(of, cell)
    with of.driven(mains_hz=50.0) as meter:
        monkeypatch.setattr(type(meter), "left", ())
        try:
            wrong = any(abs(each - INPUT_V) > 1e-4 for each in read(meter))
        except BenchError:
            wrong = True
    assert wrong


def put_out(of: Box, cell: Left | None) -> list[Any]:
    """Return what comes out at a first try: nothing before it is switched on, a level, a sine; the other channel."""
    if cell is not None:
        leave(of, cell)
    device: Any = of.device
    with of.driven() as generator:
        seen: list[Any] = [generator.configure_dc(2.5), device._driven]
        generator.enable_output()
        sleep(of.clock, 1.0)
        seen += [device._driven, generator.set_dc(0.02), device._driven, device.state.range]
        generator.configure_sine(1234.0, 2.0, 1.0)
        seen += [type(device._driven), device.state.polarity, device.state.mode]
        if isinstance(device._driven, Drive):
            seen += [replace(device._driven, phase_rad=0.0)]
        second = getattr(device, "second", None)
        seen += [] if second is None else [second.state.frequency_hz, second.state.vpp, second.state.offset_v]
    return seen


@pytest.mark.parametrize(
    ("model", "cell"), few(OF_GENERATORS, every=5), ids=lambda each: each if isinstance(each, str) else each.words[-1]
)
def test_a_generator_puts_out_the_same_whatever_was_left(model: str, cell: Left) -> None:
    clean = box(model)
    if "SOUR2" in cell.words[0]:  # the other channel may be as it was
        clean.say(cell.words[0].replace(";:SOUR1:COMB:FEED CH2", ""))
    assert put_out(box(model), cell) == put_out(clean, None)


@pytest.mark.parametrize(
    ("model", "cell"),
    disturbing(OF_GENERATORS),
    ids=lambda each: each if isinstance(each, str) else each.words[-1],
)
def test_left_setting_of_generator_disturbs_without_the_table(
    model: str, cell: Left, monkeypatch: pytest.MonkeyPatch
) -> None:
    clean = put_out(box(model), None)
    of = box(model)
    monkeypatch.setattr(Agilent33220A, "_take_over", lambda generator, _left: generator._taken_over.add("nothing"))
    monkeypatch.setattr(Agilent33220A, "_switch", _switch_where_asked)
    try:
        wrong = put_out(of, cell) != clean
    except InstrumentError:
        wrong = True
    assert wrong


def _switch_where_asked(generator: Any, wanted: str, deadline: Any = None) -> None:
    if generator._configured or deadline is not None:
        generator._session.write(f"{generator.output} {wanted.upper()}")


def seen_by(of: Box, cell: Left) -> list[float]:
    """Return what a first record tells: frequency, amplitude, volts and times of two samples; and its bench time."""
    leave(of, cell)
    with of.driven() as scope:
        begun_s = of.clock.now()
        scope.configure_timebase(2e-4)
        scope.configure_trigger(1, 0.5)
        scope.configure_channel(1, 1.0)
        scope.configure_channel(2, 1.0)
        scope.acquire(1, 2)
        record = scope.waveform(1)
        scope.acquire_mean(16, 1, 2)
        told = [
            scope.measure_frequency_hz(1),
            scope.measure_amplitude_v(1),
            scope.measure_phase_deg(1, 2),
            float(record.voltage_v[500]),
            float(record.voltage_v[600]),
            float(record.time_s[500]),
            float(record.time_s[600]),
            float(record.time_s.size),
        ]
        return [*told, float(of.clock.now() - begun_s < 1.0)]


RIGHT = [1e3, SINE.amplitude_v, 0.0, 0.5, 2.2, 0.0, 2e-4, 1000.0, 1.0]
WITHIN = [2.0, 0.1, 2.0, 0.2, 0.3, 5e-6, 5e-6, 0.0, 0.0]


def is_seen_right(of: Box, cell: Left) -> bool:
    try:
        seen = seen_by(of, cell)
    except InstrumentError as error:
        return bool(cell.named) and cell.named in str(error)
    return not cell.named and all(
        abs(each - right) <= within for each, right, within in zip(seen, RIGHT, WITHIN, strict=True)
    )


@pytest.mark.parametrize(
    ("model", "cell"),
    few([*OF_SCOPES, *((model, CLIPPED) for model in SCOPES)], every=5),
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_an_oscilloscope_is_right_whatever_was_left(model: str, cell: Left) -> None:
    assert is_seen_right(box(model), cell)


@pytest.mark.parametrize(
    ("model", "cell"),
    disturbing(OF_SCOPES),
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_left_setting_of_oscilloscope_disturbs_without_the_table(
    model: str, cell: Left, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Dso7104B, "left", ())
    monkeypatch.setattr(Dso7104B, "left_of_channel", ())
    with suppress(BenchError):
        assert not is_seen_right(box(model), replace(cell, named=""))


def supplied_by(of: Box, cell: Left) -> list[float]:
    """Return what the outputs measure while they are set and are on; and whether one was on amid the setting."""
    leave(of, cell)
    with of.driven() as supply:
        supply.configure_output("P25V", 10.0, 0.1)
        amid = supply.outputs_enabled()
        supply.configure_output("N25V", -9.0, 0.1)
        supply.enable_outputs()
        sleep(of.clock, 1.0)
        levels = [supply.measure_voltage_v(output) for output in ("P25V", "N25V", "P6V")]
        rails = [of.world.value_v(f"rail_{side}") for side in ("positive", "negative")]
        return [*levels, *rails, float(amid)]


SUPPLIED = [10.0, -9.0, 0.0, 10.0, -9.0, 0.0]


@pytest.mark.parametrize(
    ("model", "cell"), OF_SUPPLIES, ids=lambda each: each if isinstance(each, str) else each.words[0]
)
def test_a_supply_gives_the_rails_whatever_was_left(model: str, cell: Left) -> None:
    assert supplied_by(box(model), cell) == pytest.approx(SUPPLIED, abs=0.02)


@pytest.mark.parametrize(
    ("model", "cell"),
    disturbing(OF_SUPPLIES),
    ids=lambda each: each if isinstance(each, str) else each.words[0],
)
def test_left_setting_of_supply_disturbs_without_the_table(
    model: str, cell: Left, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(E36312A, "left", ())
    monkeypatch.setattr(E36312A, "_found_off", True)
    with suppress(BenchError):
        assert supplied_by(box(model), cell) != pytest.approx(SUPPLIED, abs=0.02)


@pytest.mark.parametrize(
    "cell",
    [
        left("DUTM 1", idle=True),
        left("FLOW 1", idle=True),
        left("SETN 2", idle=True),
        left("RAMP 1", idle=True),
        left("ULIM 60", named="SETP 80"),
        left("DSNS 1", idle=True),
    ],
    ids=lambda each: each.words[0],
)
def test_a_stream_of_air_is_set_whatever_was_left(cell: Left) -> None:
    of = box("ATS-545")
    leave(of, cell)
    device: Any = of.device
    with of.driven() as chamber:
        if cell.named:
            with pytest.raises(InstrumentError, match=cell.named):
                chamber.set_temperature(80.0, 50.0)
            return
        chamber.set_temperature(80.0, 50.0)
        assert not device.flow
        assert not device.settings.device_mode
        chamber.enable_flow()
        sleep(of.clock, 600.0)
        assert chamber.air_temperature_c() == pytest.approx(80.0, abs=0.2)


_BY_HAND = {"ROUT:TERM": "REAR", "SYST:FRSW": "REAR", "SYST:LFR": "60 HZ"}
_NOT_IN = {"34461A": ("SAMP:SOUR", "SAMP:COUN:PRET"), "33522B": ()}
"""Rows of the driver's table that this model of the driver's does not have."""
_UNTRIED = {":STOP", "SAMP:COUN:PRET", "FORM", "OUTP:DEL:FALL", "OUTP:PROT:CLE", ":CHAN1:VERN", ":ACQ:COMP"}
"""Rows that nothing simulated shows: what they do is not there, or has no other value."""


def rows_of(driver: Any) -> list[tuple[str, str, str]]:
    """Return header, value and refusal of each row of a driver's tables."""
    names = {"header": "VOLT" if driver.model in {"2000", "DMM6500"} else "VOLT:DC", "mains": "50"}
    names |= {"source": "CHAN1", "probe": "1"}
    rows = (*driver.left, *getattr(driver, "left_of_channel", ()))
    return [(row.header.format(**names), row.value.format(**names), row.refused) for row in rows]


@pytest.mark.parametrize("model", [*METERS, *GENERATORS, *SCOPES, *SUPPLIES, "ATS-545"])
def test_each_row_is_known_to_its_model(model: str) -> None:
    with box(model).driven() as driver:
        for header, value, refused in rows_of(driver):
            if header in _NOT_IN.get(model, ()):
                continue
            if refused:
                assert driver.session.query(f"{header}?")
            else:
                driver.session.write(f"{header} {value}".rstrip())


@pytest.mark.parametrize("model", [*METERS, *GENERATORS, *SCOPES, *SUPPLIES])
def test_each_row_is_tried_with_another_value(model: str) -> None:
    every = [*CELLS, *OF_GENERATORS, *OF_SCOPES, *OF_SUPPLIES]
    typed = [" ".join(cell.words) for named, cell in every if named == model]
    with box(model).driven() as driver:
        rows = [header for header, _, _ in rows_of(driver) if header not in (*_UNTRIED, *_NOT_IN.get(model, ()))]
    for header in rows:
        words = [_BY_HAND[header]] if header in _BY_HAND else [w for w in header.split(":") if w not in {"", "SOUR1"}]
        assert any(all(word in each for word in words) for each in typed), header
