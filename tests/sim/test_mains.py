"""What leads catch of the mains, and how whole periods take it out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.leads import Leads
from simrack.sources import Drive, Sine

from tests.sim.gyro.bench import mean_v, powered
from vcfbench.clock import VirtualClock
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.simulation import physical_parameters
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters

IDEAL = ideal_bench()
CAUGHT = replace(IDEAL, pick_up=replace(IDEAL.pick_up, meter_leads_v=10e-3, v_vc_lead_v=5e-3))


def leads_of(bench: BenchParameters, seed: int = 0) -> tuple[VirtualClock, Leads]:
    clock = VirtualClock()
    world = World(clock, bench, seed)
    return clock, Leads(world, "multimeter", {"input": "output"}, world.mains.in_meter_leads)


def test_mains_is_visible_in_short_aperture_only() -> None:
    """10 mV rms in the leads: readings of 0.4 ms scatter by it, those of 20 ms by nothing."""
    clock, leads = leads_of(CAUGHT)
    short = []
    for _ in range(400):
        start = clock.now() + 0.0013
        window = leads.window("input", start, start + 0.4e-3)
        clock.sleep_until(start + 0.4e-3)
        short.append(window.mean_v())
    assert np.std(short) == pytest.approx(10e-3 * np.sinc(50.0 * 0.4e-3), rel=0.02)
    for cycles in (1, 10, 100):
        window = leads.window("input", clock.now(), clock.now() + cycles * 0.02)
        clock.sleep_until(clock.now() + cycles * 0.02)
        assert abs(window.mean_v()) < 1e-12


def test_line_off_its_frequency_matches_the_closed_form() -> None:
    bench = replace(CAUGHT, pick_up=replace(CAUGHT.pick_up, mains_deviation_hz=0.05))
    frequencies, worst = [], []
    for seed in range(20):
        clock, leads = leads_of(bench, seed)
        sine = leads.lead("input").pick_up
        assert sine is not None
        frequencies.append(sine.frequency_hz)
        means = []
        for _ in range(12):
            start = clock.now() + 0.0013
            window = leads.window("input", start, start + 0.2)
            clock.sleep_until(start + 0.2)
            means.append(window.mean_v())
        worst.append(np.max(np.abs(means)) / (14.142e-3 * abs(np.sinc(sine.frequency_hz * 0.2))))
    assert np.std(frequencies) == pytest.approx(0.05, rel=0.5)
    assert max(worst) <= 1.001


def test_the_meters_ways_of_looking_agree() -> None:
    """Window, record, history and the volts of a moment, the leads reversed too."""
    clock, leads = leads_of(CAUGHT)
    leads.connect("input", "v_vc")
    leads._world.drive("v_vc", Drive(0.5, source_ohm=0.0))
    for reversed_ in (False, True):
        leads.turn("input", reversed_=reversed_)
        trace = leads.trace(1.0)
        start = clock.now()
        window, capture = leads.window("input", start, start + 0.013), leads.capture(start, start + 0.013)
        clock.sleep_until(start + 0.013)
        times = start + (np.arange(13_000) + 0.5) * 1e-6
        volts = capture.samples("input", times)
        assert window.mean_v() == pytest.approx(volts.mean(), abs=1e-9)
        piece = trace.pieces("input")[-1]
        assert piece.at(times) == pytest.approx(volts, abs=1e-12)
        assert piece.sines is not None
        summed = piece.dc_v + sum(
            sine.amplitude_v * np.sin(math.tau * sine.frequency_hz * (times - piece.start_s) + sine.phase_rad)
            for sine in piece.sines
        )
        assert summed == pytest.approx(volts, abs=1e-12)
        last = capture.samples("input", np.array([start + 0.013]))[0]
        assert leads.value_v("input") == pytest.approx(last, abs=1e-9)
        assert np.ptp(volts) > 10e-3


def test_v_vc_lead_brings_mains_to_gyroscope() -> None:
    """5 mV rms of 50 Hz go through the modes to the output; means of whole periods have nothing of them."""
    shown = {}
    for name, bench in (("clean", IDEAL), ("caught", CAUGHT)):
        clock, world = powered(bench)
        world.drive("v_vc", Drive(0.0, source_ohm=0.0))
        clock.sleep_until(8.0)
        capture, start = world.capture(8.0, 8.2), clock.now()
        clock.sleep_until(8.2)
        shown[name] = capture.samples("output", start + np.arange(2000) * 1e-4), mean_v(clock, world, 0.2)
    clock, world = powered(IDEAL)
    world.drive("v_vc", Drive(0.0, 5e-3 * math.sqrt(2), 50.0, source_ohm=0.0))
    clock.sleep_until(8.0)
    capture = world.capture(8.0, 8.2)
    clock.sleep_until(8.2)
    wanted = capture.samples("output", 8.0 + np.arange(2000) * 1e-4).std()
    assert (shown["caught"][0] - shown["clean"][0]).std() == pytest.approx(wanted, rel=1e-6)
    assert shown["caught"][1] == pytest.approx(shown["clean"][1], abs=1e-9)


def test_an_open_lead_brings_nothing_and_what_plays_is_overlaid() -> None:
    world = World(VirtualClock(), CAUGHT, 0)
    assert world.mains.through_v_vc_lead(None) is None
    drive = Drive(0.2)
    overlaid = world.mains.through_v_vc_lead(drive)
    assert isinstance(overlaid, Drive)
    sine = world.mains.in_v_vc_lead
    assert overlaid.overtones == (sine,)
    assert sine is not None
    assert sine.amplitude_v == pytest.approx(5e-3 * math.sqrt(2))
    assert isinstance(sine, Sine)


def test_the_embedded_bench_has_it_and_the_ideal_one_not() -> None:
    paper, ideal = (physical_parameters(load_bench(name)).pick_up for name in (None, "ideal"))
    assert (paper.meter_leads_v, paper.v_vc_lead_v, paper.mains_hz) == (1e-3, 20e-6, 50.0)
    assert (ideal.meter_leads_v, ideal.v_vc_lead_v) == (0.0, 0.0)


def test_phases_go_with_the_seed() -> None:
    drawn = [World(VirtualClock(), CAUGHT, seed).mains for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
