from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
import serial

from vcfbench.bench.visa_resolver import resolve
from vcfbench.clock import ScaledClock, VirtualClock
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import load_bench, parse_bench
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.virtual_coriolis.plan import VIRTUAL_CORIOLIS
from vcfbench.sim.builder import SimulatedBench, instrument_errors
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.file import embedded_text
from vcfbench.station.overrides import overridden

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.station.description import BenchDescription

PAPER = embedded_text("paper")


def paper_bench(more: str = "") -> SimulatedBench:
    return SimulatedBench.build(parse_bench(PAPER + more, "paper"), 0, VirtualClock())


def test_pyvisa_and_pyserial_reach_every_instrument_by_name() -> None:
    bench = paper_bench()
    with bench.registered() as handle:
        manager = pyvisa.ResourceManager(f"{handle}@vcfbench")
        answers = {
            role: manager.open_resource(getattr(bench.description, role).resource).query("*IDN?")  # type: ignore[attr-defined]
            for role in ("power", "rate_source", "multimeter", "oscilloscope")
        }
        for role, answer in answers.items():
            assert getattr(bench.description, role).model in answer
        with serial.serial_for_url(f"sim://{handle}", timeout=1.0) as port:
            port.write(b"*IDN?\r\n")
            assert b"Acutrol" in port.readline()
        manager.close()


def test_benches_of_one_name_do_not_meet() -> None:
    first, second = paper_bench(), paper_bench()
    with first.registered() as one, second.registered() as other:
        assert (one, other) == ("paper", "paper-2")
        manager = pyvisa.ResourceManager(f"{other}@vcfbench")
        manager.open_resource("GPIB0::22::INSTR").query("READ?")  # type: ignore[attr-defined]
        assert second.clock.now() > 0.3  # 10 PLC with autozero take 0.4 s
        assert first.clock.now() == 0.0
        manager.close()
    with first.registered() as again:
        assert again == "paper"


def test_invalid_visa_resource_is_bench_file_error() -> None:
    description = parse_bench(PAPER.replace("GPIB0::22::INSTR", "the meter"), "paper")
    bench = SimulatedBench.build(description, 0, VirtualClock())
    with pytest.raises(ConfigError, match="not a VISA resource name"):
        bench.registered().__enter__()
    with paper_bench().registered() as handle:
        assert handle == "paper"


def test_any_program_opens_the_bench_by_its_file(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(PAPER.replace("GPIB0::22", "GPIB0::17"), "utf-8")
    manager = pyvisa.ResourceManager(f"{path}@vcfbench")
    assert "GPIB0::17::INSTR" in manager.list_resources()
    assert "34401A" in manager.open_resource("GPIB0::17::INSTR").query("*IDN?")  # type: ignore[attr-defined]
    manager.close()


def test_free_clock_stops_while_instrument_computes() -> None:
    """An acquisition begins at the instant at which it was asked for, however fast time goes meanwhile."""
    bench = SimulatedBench.build(load_bench(None), 0, ScaledClock(10_000.0))
    with bench.registered() as handle:
        scope: Any = pyvisa.ResourceManager(f"{handle}@vcfbench").open_resource(bench.description.oscilloscope.resource)
        scope.timeout = 10_000_000
        for _ in range(5):
            scope.write(":DIG")
            assert scope.query("*OPC?") == "1\n"
        scope.close()


def test_without_a_file_it_is_the_paper_bench() -> None:
    devices, _ = resolve("")
    assert list(devices) == list(SimulatedBench.build(load_bench(None), 0, VirtualClock()).visa_devices())


def test_a_file_that_is_no_simulated_bench_is_no_library(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="there is no such file"):
        resolve(str(tmp_path / "none.toml"))
    real = tmp_path / "real.toml"
    real.write_text(embedded_text("station"), "utf-8")
    with pytest.raises(OSError, match="expected a bench with a table \\[simulation\\]"):
        resolve(str(real))


def test_errors_are_none_drawn_or_told() -> None:
    text = PAPER.replace(
        "[simulation.errors.rate_source]", '[simulation.errors]\npower = "none"\n[simulation.errors.rate_source]'
    )
    description = parse_bench(text.replace("dac_bits = 14", "dac_bits = 12"), "paper")
    drawn, other = instrument_errors(description, 1), instrument_errors(description, 2)
    assert drawn["power"] == type(drawn["power"]).none()
    assert drawn["rate_source"] == other["rate_source"]
    assert drawn["rate_source"].dac_bits == 12
    assert drawn["multimeter"] != other["multimeter"]
    assert drawn["multimeter"] == instrument_errors(description, 1)["multimeter"]


def part_drawn(role: str, errors: str) -> BenchDescription:
    """Return the paper bench with the errors of one role as the bench file may have them."""
    text = PAPER.partition("[simulation.errors.rate_source]")[0]
    return parse_bench(f"{text}[simulation.errors]\n{role} = {errors}\n", "paper")


def test_errors_are_drawn_as_large_as_told() -> None:
    whole = instrument_errors(part_drawn("rate_source", '"drawn"'), 3)["rate_source"]
    part = instrument_errors(part_drawn("rate_source", "{ drawn = 0.25, dac_bits = 12 }"), 3)["rate_source"]
    assert (part.dac_bits, part.setting_digits) == (12, whole.setting_digits)
    assert part.frequency_error == pytest.approx(0.25 * whole.frequency_error, rel=1e-12)
    for mine, published in zip(part.ranges, whole.ranges, strict=True):
        assert mine.upper_v == published.upper_v
        assert mine.gain_error == pytest.approx(0.25 * published.gain_error, rel=1e-12)
        assert mine.offset_error_v == pytest.approx(0.25 * published.offset_error_v, rel=1e-12)


@pytest.mark.parametrize("role", ["power", "rate_source", "multimeter", "oscilloscope", "rate_table"])
def test_drawn_share_0_is_ideal_and_share_1_published(role: str) -> None:
    none, all_of_it, ideal, published = (
        instrument_errors(part_drawn(role, errors), 3)[role]
        for errors in ("{ drawn = 0.0 }", "{ drawn = 1.0 }", '"none"', '"drawn"')
    )
    assert none == ideal
    assert all_of_it == published


@pytest.mark.parametrize("share", ["-0.1", "11.0", '"much"', "true"])
def test_a_share_that_cannot_be_is_refused(share: str) -> None:
    with pytest.raises(
        ConfigError, match=r"paper: simulation\.errors\.multimeter\.drawn: expected a number from 0 to 10"
    ):
        part_drawn("multimeter", f"{{ drawn = {share} }}")


def test_stated_generator_error_overrides_data_sheet() -> None:
    text = PAPER.replace("[uncertainty]", "[uncertainty]\ngenerator_error = 0.005\ngenerator_offset_v = 1e-3")
    known, sheet = (settings_of(VIRTUAL_CORIOLIS, parse_bench(each, "paper")).station.sources for each in (text, PAPER))
    assert (known.generator_gain, known.generator_offset_v) == (0.005, 1e-3)
    assert (sheet.generator_gain, sheet.generator_offset_v) == (0.02, 4e-3)


def test_single_parameters_are_overridden_and_nothing_else() -> None:
    plain = physical_parameters(load_bench(None)).rows()
    more = "[simulation.override]\noutput_stage.offset_v = 0.5\nsense_path.low_pass_order = 3\n"
    changed = physical_parameters(parse_bench(PAPER + more, "paper")).rows()
    different = {after.path: after.value for before, after in zip(plain, changed, strict=True) if before != after}
    assert different == {"output_stage.offset_v": 0.5, "sense_path.low_pass_order": 3}


def test_ideal_and_paper_differ() -> None:
    assert physical_parameters(load_bench("ideal")).rows() != physical_parameters(load_bench("paper")).rows()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("output_stage.offset_vv = 1", "override.output_stage.offset_vv: expected a known name ('offset_v'?), got 1"),
        ("output_stage.offset_v = 'a'", "override.output_stage.offset_v: expected a number, got 'a'"),
        ("output_stage = 3", "override.output_stage: expected a table with gain, offset_v, "),
        ("xyzzy = 3", "override.xyzzy: expected one of 14 names (drive_mode, "),
        ("table.ripple_arcsec = 3", "override.table.ripple_arcsec: expected a list, got 3"),
        ("sense_path.low_pass_order = 3.5", "override.sense_path.low_pass_order: expected a whole number, got 3.5"),
    ],
)
def test_a_parameter_that_is_none_is_refused(more: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_bench(f"{PAPER}\n[simulation.override]\n{more}\n", "lab.toml")
    assert str(caught.value).startswith(f"lab.toml: simulation.{said}")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("supply.dead_v = 9.5", "supply.dead_v at most brown_out_v, and that at most start_v, got [9.5, "),
        (
            "table.ripple_arcsec = [1.0]",
            "table.ripple_arcsec, ripple_harmonic and ripple_phase_rad of one length, got [1",
        ),
        ("drive_mode.quality_coefficient_per_k = -4.0", "drive_mode.quality above 0.5 at every temperature from"),
    ],
)
def test_contradictory_parameters_are_refused_in_bench_file(more: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_bench(f"{PAPER}\n[simulation.override]\n{more}\n", "lab.toml")
    assert str(caught.value).startswith(f"lab.toml: simulation.override: expected {said}")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("dac_bits = 14", "dac_bitts = 14", "dac_bitts: expected a known name ('dac_bits'?), got 14"),
        ("dac_bits = 14", 'dac_bits = "a"', "dac_bits: expected a whole number, got 'a'"),
        ("gain_error", "gain", "ranges: expected every entry to have gain_error, got ["),
    ],
)
def test_an_instrument_error_that_is_none_is_refused(old: str, new: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_bench(PAPER.replace(old, new), "lab.toml")
    assert str(caught.value).startswith(f"lab.toml: simulation.errors.rate_source.{said}")


def test_what_is_not_overridden_is_not_converted() -> None:
    """Two threads that convert to one class for the first time end the interpreter (seen with msgspec 0.22)."""
    parameters = physical_parameters(parse_bench(PAPER, "paper"))
    assert overridden(parameters, {}) is parameters
