"""A table turns on when the program that set it turning is killed: real processes, real wires, each language.

What is killed here is the client. A served bench that is killed itself takes its World along: nothing turns any more.
"""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from simrack.serve.remote import Control
from simrack_tests.cells import few
from simrack_tests.rate_tables.turning import RATE, START

from tests import warm
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

CLIENT = """
import itertools, sys, serial
port = serial.serial_for_url(sys.argv[1], timeout=5.0)
for message in itertools.cycle(sys.argv[2:]):
    port.write(bytes.fromhex(message))
    print("sent", flush=True)
    if sys.stdin.readline().strip() == "close":
        port.close()
        break
"""
TRACKING = [b":MODE:TRACK 1,3000;:INT:CLOSE 1\n", b":DEM:VECTOR 1,0,50,0\n"]


def bench_file(folder: Path, dialect: str) -> Path:
    said = "\nsteps_per_deg = 1777.7777777777778" if dialect == "zaber" else ""
    file = folder / "bench.toml"
    file.write_text(embedded_text("ideal").replace('dialect = "acl"', f'dialect = "{dialect}"{said}'), encoding="utf-8")
    return file


@contextmanager
def served(bench: Path) -> Iterator[tuple[dict[str, Any], Control]]:
    words = ["vcfbench", "sim", "serve", "--json", "--bench", str(bench)]
    with warm.running(words, bench.parent) as process:
        said = json.loads(process.stdout.readline())
        with Control(said["control"]["port"]) as control:
            yield said["instruments"]["rate_table"], control


@contextmanager
def client(resource: str, messages: list[bytes], control: Control) -> Iterator[subprocess.Popen[str]]:
    """Start a program that sends messages, a second of bench time apart, until the table turns, and holds the port.

    Bytes on a terminal may be seen later than a request on the control port, hence the repetition.
    """
    words = [sys.executable, "-c", CLIENT, resource, *(message.hex() for message in messages)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            for number in range(1, 40 * len(messages)):
                assert process.stdout.readline() == "sent\n"
                for _ in range(4):
                    control.request("advance", seconds=0.25)
                if number % len(messages) == 0 and turns(control):
                    break
                process.stdin.write("\n")
                process.stdin.flush()
            yield process
        finally:
            process.kill()


def turns(control: Control) -> bool:
    return bool(control.request("get", name="applied_rate_deg_s") == pytest.approx(RATE, rel=1e-3))


def gone(process: subprocess.Popen[str], end: str) -> None:
    assert process.stdin is not None
    if end == "killed":
        process.kill()
    else:
        process.stdin.write("close\n")
        process.stdin.flush()
    process.wait(10)


@pytest.mark.parametrize(("wire", "end"), few([("tcp", "killed"), ("pty", "closed")], every=2))
@pytest.mark.parametrize("dialect", few(START, "acl", "aaaa"))
def test_the_table_turns_on_when_its_host_has_gone(dialect: str, wire: str, end: str, tmp_path: Path) -> None:
    if wire == "pty" and sys.platform == "win32":
        pytest.skip("no pseudo-terminals")
    with served(bench_file(tmp_path, dialect)) as (wires, control):
        with client(wires[wire], START[dialect], control) as process:
            assert turns(control)
            gone(process, end)
        # aaaa knows no endless run: 800 deg are 16 s
        control.request("advance", seconds=600.0 if dialect != "aaaa" else 5.0)
        assert turns(control)


def test_a_host_that_streams_demands_is_missed_when_killed(tmp_path: Path) -> None:
    """TRACK mode is the only watchdog of any of the eight languages (TM-8004-C 4.7.7)."""
    with served(bench_file(tmp_path, "acl")) as (wires, control):
        with client(wires["tcp"], TRACKING, control) as process:
            assert control.request("get", name="applied_rate_deg_s") > 10.0
            gone(process, "killed")
        control.request("advance", seconds=10.0)
        assert control.request("get", name="applied_rate_deg_s") == pytest.approx(0.0, abs=1e-6)


def test_interlocks_are_thrown_over_the_control_port(tmp_path: Path) -> None:
    with served(bench_file(tmp_path, "esp")) as (wires, control), client(wires["tcp"], START["esp"], control):
        control.request("set", name="rate_table.interlock.door", value=True)
        control.request("advance", seconds=60.0)
        assert control.request("get", name="applied_rate_deg_s") == pytest.approx(0.0, abs=1e-6)
        assert control.request("get", name="rate_table.shut_down_by") == ["door"]
