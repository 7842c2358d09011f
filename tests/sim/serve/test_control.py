"""The control port, the remote clock and faults on the wire."""

from __future__ import annotations

import json
import socket
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import pytest
from simrack.faults import Fault, FaultScript
from simrack.serve import (
    MAX_SPEED,
    Adjustment,
    Control,
    ControlError,
    RemoteClock,
    ServedClock,
    ServerSettings,
)
from simrack_tests.ports import eventually
from simrack_tests.serve.lamp import ALL, IDENTITY, Lamp, Served, served_lamp, serving
from simrack_tests.serve.test_raw import Wire, wires
from simrack_tests.serve.test_vxi11 import callers

from vcfbench.clock import sleep
from vcfbench.errors import ConfigError
from vcfbench.sim.fault_scripts import read_script
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


class DimmableLamp(Lamp):
    """A lamp with something to change from outside."""

    def adjustments(self) -> list[Adjustment]:
        def set_level(volts: float) -> None:
            self.level_v = volts

        return [Adjustment("knob_v", "V", "the knob on its front", lambda: self.level_v, set_level)]


@pytest.fixture
def served() -> Iterator[Served]:
    clock = ServedClock(1.0)
    world = World(clock, ideal_bench(), seed=1)
    with serving({"lamp": DimmableLamp(clock)}, clock, ServerSettings(offers={"lamp": ALL}), world) as lamp:
        yield lamp


@contextmanager
def controls(served: Served) -> Iterator[Control]:
    with Control(served.server.control.port) as connection:
        yield connection


@pytest.fixture
def control(served: Served) -> Iterator[Control]:
    with controls(served) as connection:
        yield connection


# --- the World -------------------------------------------------------------------------------------------------


def test_a_rate_is_applied_without_a_table(control: Control) -> None:
    control.request("set", name="applied_rate_deg_s", value=25.0)
    control.request("advance", seconds=1.0)
    assert control.request("get", name="applied_rate_deg_s") == pytest.approx(25.0, rel=1e-3)


def test_everything_is_listed_with_its_unit(control: Control) -> None:
    rows = {row["name"]: row for row in control.request("list")}
    assert rows["node.output"]["unit"] == "V"
    assert not rows["node.output"]["writable"]
    assert rows["applied_rate_deg_s"]["writable"]
    assert rows["lamp.knob_v"]["meaning"] == "the knob on its front"
    assert "parameter.thermal.ambient_c" in rows
    assert {row["name"] for row in control.request("list", match="rail.")} < set(rows)


def test_a_value_of_every_quantity_can_be_read(control: Control) -> None:
    for row in control.request("list"):
        json.dumps(control.request("get", name=row["name"]))


def test_what_a_device_offers_is_changed_behind_its_wire(served: Served, control: Control) -> None:
    assert control.request("set", name="lamp.knob_v", value=7.5) == 7.5
    with wires(served) as (wire,):
        assert wire.ask(b"LEV?\n") == b"+7.50000000E+00\n"


def test_rails_and_input_are_put_on_from_outside(control: Control) -> None:
    assert control.request("set", name="rail.positive.voltage_v", value=10.0) == 10.0
    assert control.request("set", name="rail.negative.voltage_v", value=-10.0) == -10.0
    control.request("advance", seconds=5.0)
    assert control.request("get", name="rail.positive.current_a") > 0.0
    assert control.request("set", name="node.v_vc", value=1.0) == pytest.approx(1.0, rel=0.01)
    assert control.request("set", name="node.v_vc", value=None) == 0.0


def test_what_cannot_be_done_is_refused_with_words(control: Control) -> None:
    refused: list[tuple[dict[str, Any], str]] = [
        ({"do": "get", "name": "nonsense"}, "there is no 'nonsense'; `ctl` lists all names"),
        ({"do": "set", "name": "angle_deg", "value": 1.0}, "can be read, not changed"),
        ({"do": "set", "name": "applied_rate_deg_s", "value": "fast"}, "expected a number, not 'fast'"),
        ({"do": "set", "name": "ambient_c", "value": True}, "expected a number, not True"),
        ({"do": "set", "name": "ambient_c", "value": "nan"}, "expected a number, not 'nan'"),
        ({"do": "set", "name": "ambient_c", "value": 1e300}, "at most 1e\\+09 either sign"),
        ({"do": "speed", "value": 1e300}, "from 1e-06 to 1e\\+06 times real time"),
        ({"do": "speed", "value": True}, "speed is a number, not True"),
        ({"do": "speed", "value": "fast"}, "speed is a number, not 'fast'"),
        ({"do": "advance", "seconds": True}, "seconds is a number, not True"),
        ({"do": "reset", "seed": 1 << 63}, "a seed is a whole number from 0 to"),
        ({"do": "fault", "instrument": "lamp", "kind": "late", "delay_s": "long"}, "float"),
        ({"do": "fault", "instrument": "lamp", "kind": "late", "delay_s": True}, "float"),
        ({"do": "fault", "instrument": "lamp", "kind": "late", "delay_s": 1e300}, "delay_s is at most 1e\\+09"),
        ({"do": "speed", "value": -1}, "greater than 0"),
        ({"do": "advance", "seconds": -1}, "time goes forwards"),
        ({"do": "nonsense"}, "is one of"),
        ({"do": "get"}, "argument"),
        ({"do": "fault", "instrument": "toaster", "kind": "silent"}, "no 'toaster'"),
        ({"do": "fault", "instrument": "lamp", "kind": "fire"}, "a fault is one of"),
        ({"do": "fault", "instrument": "lamp", "kind": "interlock"}, "lamp does not have the fault 'interlock'"),
        ({"do": "fault", "instrument": "lamp", "kind": "late", "late_s": 2}, "late_s"),
    ]
    for request, words in refused:
        with pytest.raises(ControlError, match=words):
            control.request(**request)
    assert control.request("status")["instruments"]["lamp"]["model"] == "lamp"


def test_noise_is_refused_and_the_connection_lives(served: Served) -> None:
    with socket.create_connection(("127.0.0.1", served.server.control.port), timeout=5.0) as raw:
        raw.sendall(b"noise\n[1]\n")
        file = raw.makefile("rb")
        assert not json.loads(file.readline())["ok"]
        assert not json.loads(file.readline())["ok"]
        file.close()


# --- time ------------------------------------------------------------------------------------------------------


def test_a_pause_stops_time(control: Control) -> None:
    paused = control.request("pause")
    assert control.request("now") == paused
    control.request("advance", seconds=3.0)
    assert control.request("now") == paused + 3.0
    control.request("resume")
    eventually(lambda: control.request("now") > paused + 3.0)


def test_the_speed_changes(control: Control) -> None:
    assert control.request("speed", value=1000) == 1000.0
    start = control.request("now")
    eventually(lambda: control.request("now") > start + 10.0)
    assert control.request("speed", value="max") == "max"
    assert control.request("status")["speed"] == "max"


def test_a_led_clock_goes_as_far_as_it_is_told(served: Served, control: Control) -> None:
    clock = RemoteClock(control)
    start = clock.now()
    with wires(served) as (wire,):
        first = float(wire.ask(b"TIME?\n"))
        sleep(clock, 12.5)
        assert first == pytest.approx(start, rel=1e-11)
        assert float(wire.ask(b"TIME?\n")) == pytest.approx(start + 12.5, rel=1e-11)
        wire.ask(b"READ?\n")
        assert clock.now() == pytest.approx(start + 13.5, abs=1e-9)


def test_what_was_sent_before_a_wait_happens_before_it(served: Served, control: Control) -> None:
    clock = RemoteClock(control)
    with wires(served) as (wire,):
        for _ in range(50):
            start = clock.now()
            wire.send(b"DIM 1\n")
            sleep(clock, 5.0)
            assert wire.ask(b"*IDN?\n") == IDENTITY
            assert served.lamp.dimmed_at_s.pop() == pytest.approx(start + 1.0, abs=1e-9)


def test_one_leads_at_a_time_and_time_runs_again_after(served: Served, control: Control) -> None:
    control.request("lead")
    with controls(served) as other:
        with pytest.raises(ControlError, match="leads the clock"):
            other.request("lead")
        with pytest.raises(ControlError, match="leads the clock"):
            other.request("advance", seconds=1.0)
        control.close()
        eventually(lambda: not other.request("status")["lockstep"])
        now = other.request("now")
        eventually(lambda: other.request("now") > now)


def test_stop_ends_the_server() -> None:
    with served_lamp() as served, controls(served) as control:
        control.request("stop")
        eventually(lambda: not served.server.loop.running)


# --- faults ----------------------------------------------------------------------------------------------------


def test_a_silent_instrument_answers_nobody(served: Served, control: Control) -> None:
    with wires(served) as (wire,):
        control.request("fault", instrument="lamp", kind="silent")
        wire.send(b"*IDN?\n")
        assert wire.silent(0.05)
        assert control.request("status")["instruments"]["lamp"]["faults"] == ["silent"]
        control.request("clear_faults")
        assert wire.ask(b"LEV?\n") == b"+0.00000000E+00\n"


def test_a_fault_lasts_as_long_as_it_is_said_to(served: Served, control: Control) -> None:
    with wires(served) as (wire,):
        control.request("pause")
        control.request("fault", instrument="lamp", kind="garbled", duration_s=10.0)
        said, heard = b"+1.00000000E+00\n", wire.ask(b"LEV 1;LEV?\n")
        assert [byte > 0x7F for byte, meant in zip(heard, said, strict=True) if byte != meant] == [True]
        control.request("advance", seconds=10.0)
        assert wire.ask(b"LEV?\n") == b"+1.00000000E+00\n"


def test_a_truncated_answer_has_no_end(served: Served, control: Control) -> None:
    with wires(served) as (wire,):
        control.request("fault", instrument="lamp", kind="truncated")
        wire.send(b"LEV?\n")
        assert wire.file.read(8) == b"+0.00000"
        assert wire.silent(0.05)


def test_a_read_over_vxi11_suffers_too(served: Served, control: Control) -> None:
    with callers(served.port("vxi11")) as (caller,):
        link = caller.link()[1]
        control.request("fault", instrument="lamp", kind="silent")
        caller.write(link, b"*IDN?")
        assert caller.read(link, io_ms=50)[0] == 15


def test_an_answer_comes_late_and_none_overtakes_it(served: Served, control: Control) -> None:
    with wires(served, 2) as (first, second), callers(served.port("vxi11")) as (caller,):
        control.request("pause")
        control.request("fault", instrument="lamp", kind="late", delay_s=3.0, duration_s=1.0)
        first.send(b"*IDN?\n")
        link = caller.link()[1]
        caller.write(link, b"LEV?")
        control.request("advance", seconds=2.0)
        second.send(b"LEV?\n")
        assert first.silent(0.05)
        assert second.silent(0.05)
        control.request("advance", seconds=1.0)
        assert first.line() == IDENTITY
        assert second.line() == b"+0.00000000E+00\n"
        assert caller.read(link)[2] == b"+0.00000000E+00\n"


def test_a_late_answer_over_vxi11_is_waited_for() -> None:
    with served_lamp(MAX_SPEED) as served, controls(served) as control, callers(served.port("vxi11")) as (caller,):
        link = caller.link()[1]
        control.request("fault", instrument="lamp", kind="late", delay_s=30.0)
        before = control.request("now")
        caller.write(link, b"LEV?")
        assert caller.read(link)[2] == b"+0.00000000E+00\n"
        assert control.request("now") - before >= 30.0


def test_noise_comes_before_an_answer(served: Served, control: Control) -> None:
    with wires(served) as (wire,):
        control.request("fault", instrument="lamp", kind="garbage")
        heard = wire.ask(b"*IDN?\n")
        assert heard.endswith(IDENTITY)
        assert not heard.isascii()


def test_a_fault_comes_at_its_time_unless_it_is_forgotten(served: Served, control: Control) -> None:
    with wires(served) as (wire,):
        control.request("pause")
        at_s = control.request("now") + 5.0
        control.request("fault", instrument="lamp", kind="silent", at_s=at_s)
        assert wire.ask(b"*IDN?\n") == IDENTITY
        control.request("advance", seconds=5.0)
        assert control.request("status")["instruments"]["lamp"]["faults"] == ["silent"]
        control.request("clear_faults")
        control.request("fault", instrument="lamp", kind="silent", at_s=at_s + 5.0)
        control.request("clear_faults", instrument="lamp")
        control.request("advance", seconds=5.0)
        assert wire.ask(b"*IDN?\n") == IDENTITY


def test_connections_are_cut_once(served: Served, control: Control) -> None:
    with wires(served, 3) as cut:
        for each in cut:
            assert each.ask(b"*IDN?\n") == IDENTITY
        control.request("fault", instrument="lamp", kind="disconnect")
        assert [each.line() for each in cut] == [b"", b"", b""]
    with wires(served) as (wire,):
        assert wire.ask(b"*IDN?\n") == IDENTITY


def test_an_unreachable_instrument_takes_no_connections(served: Served, control: Control) -> None:
    control.request("fault", instrument="lamp", kind="unreachable")
    refused = Wire(served.port("tcp"))
    assert refused.line() == b""
    refused.close()
    control.request("clear_faults", instrument="lamp")
    with wires(served) as (wire,):
        assert wire.ask(b"*IDN?\n") == IDENTITY


def test_an_error_is_put_in_the_queue(served: Served, control: Control) -> None:
    control.request("fault", instrument="lamp", kind="error", number=-330)
    with wires(served) as (wire,):
        assert wire.ask(b"SYST:ERR?\n").startswith(b"-330")


def test_faults_of_a_file_come_at_their_times(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text('[[fault]]\ninstrument = "lamp"\nkind = "garbled"\nat_s = 5.0\nduration_s = 2.0\n')
    planned = read_script(path)
    assert planned == FaultScript((Fault("lamp", "garbled", 5.0, 2.0),))
    with served_lamp(MAX_SPEED, ServerSettings(faults=planned)) as served, controls(served) as control:
        clock = RemoteClock(control)
        with wires(served) as (wire,):
            answers = []
            for instant_s in (4.9, 5.0, 6.9, 7.1):
                clock.sleep_until(instant_s)
                answers.append(not wire.ask(b"LEV?\n").isascii())
        assert answers == [False, True, True, False]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[fault]]\nkind = "silent"\n', "fault 1: expected instrument and kind"),
        ('[[fault]]\ninstrument = "lamp"\nkind = "fire"\n', "fault 1: a fault is one of"),
        ('[[fault]]\ninstrument = "lamp"\nkind = "silent"\nwhen = 3\n', "fault 1: expected"),
        ('[[fault]]\ninstrument = "lamp"\nkind = "silent"\nat_s = -3\n', "fault 1: a fault begins"),
        ("[[fault\n", "expected TOML"),
    ],
)
def test_a_bad_fault_file_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        read_script(path)


def test_a_control_port_that_is_not_there() -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with pytest.raises(ControlError, match="no bench is served"):
        Control(port)


def test_reply_to_aborted_request_is_not_taken_for_next() -> None:
    with served_lamp() as served, controls(served) as control:
        control._socket.sendall(b'{"do": "status", "id": 0}\n')
        assert isinstance(control.request("now"), float)
        assert control.request("status")["seed"] is None


def test_who_asks_without_end_is_left(served: Served, control: Control) -> None:
    port = served.server.control.port
    with socket.create_connection(("127.0.0.1", port), timeout=20.0) as raw, suppress(ConnectionError):
        raw.sendall(b"\n" * 200_000)
        while raw.recv(1 << 16):
            pass
    assert control.request("now") >= 0.0


def test_a_port_that_is_no_control_port_is_told(served: Served) -> None:
    with Control(served.port("tcp"), timeout_s=5.0) as control:
        control._socket.sendall(b"*IDN?\n")
        with pytest.raises(ControlError, match="not as the control port"):
            control.request("now")


def test_another_user_is_told_that_the_port_is_not_his(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simrack.serve.control.is_welcome", lambda _: False)
    with (
        Control(served.server.control.port, timeout_s=5.0) as control,
        pytest.raises(ControlError, match="served by another user"),
    ):
        control.request("stop")
    monkeypatch.undo()
    with Control(served.server.control.port) as control:
        assert control.request("now") >= 0.0
