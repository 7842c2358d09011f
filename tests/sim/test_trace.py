"""The recent history of the nodes: what a filter that remembers is fed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack.leads import Leads
from simrack.sources import Drive, Sine

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from simrack.trace import Piece


@pytest.fixture
def world() -> World:
    return World(VirtualClock(), ideal_bench(), 0)


def _sum(piece: Piece, times_s: np.ndarray) -> np.ndarray:
    assert piece.sines is not None
    elapsed = times_s - piece.start_s
    swung = (s.amplitude_v * np.sin(2 * np.pi * s.frequency_hz * elapsed + s.phase_rad) for s in piece.sines)
    return np.asarray(piece.dc_v + sum(swung, start=np.zeros_like(elapsed)))


def test_the_sines_of_a_piece_are_the_waveform(world: World) -> None:
    world.clock.sleep_until(0.123)
    trace = world.trace(1.0)
    world.drive("v_vc", Drive(0.3, 1.5, 1e6, 0.4, overtones=(Sine(0.5, 3e6, 1.0),)))
    world.clock.sleep_until(0.456)
    (piece,) = trace.pieces("v_vc")
    times = 0.2 + np.linspace(0.0, 3e-6, 50)
    assert _sum(piece, times) == pytest.approx(piece.at(times), abs=1e-8)
    assert (piece.start_s, piece.stop_s) == (0.123, 0.456)


def test_change_of_source_starts_new_piece(world: World) -> None:
    trace = world.trace(0.5)
    for volts in (1.0, 2.0, 3.0):
        world.drive("v_vc", Drive(volts, source_ohm=0.0))
        world.clock.sleep_until(world.clock.now() + 0.3)
    assert [piece.dc_v for piece in trace.pieces("v_vc")] == pytest.approx([2.0, 3.0])
    world.clock.sleep_until(1.2)
    assert [piece.dc_v for piece in trace.pieces("v_vc")] == pytest.approx([3.0, 3.0])
    trace.end()
    world.clock.sleep_until(2.0)
    assert trace.pieces("v_vc") == []


def test_node_without_power_is_zero(world: World) -> None:
    trace = world.trace(10.0)
    world.clock.sleep_until(1.0)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    world.clock.sleep_until(3.0)
    pieces = trace.pieces("output")
    assert pieces[0].sines == ()
    assert pieces[-1].sines is None
    times = np.linspace(2.9, 3.0, 5)
    assert pieces[-1].at(times).shape == times.shape


def test_leads_reverse_exchange_and_free(world: World) -> None:
    leads = Leads(world, "multimeter", {"input": "v_vc"})
    trace = leads.trace(1.0)
    world.drive("v_vc", Drive(1.0, 2.0, 50.0, source_ohm=0.0))
    world.clock.sleep_until(0.1)
    leads.turn("input", reversed_=True)
    (piece,) = trace.pieces("input")
    assert piece.dc_v == pytest.approx(-1.0)
    times = np.linspace(0.0, 0.1, 7)
    assert piece.at(times) == pytest.approx(_sum(piece, times))
    assert piece.at(times) == pytest.approx(-1.0 - 2.0 * np.sin(2 * np.pi * 50.0 * times))
    leads.connect("input", None)
    assert trace.pieces("input") == []
