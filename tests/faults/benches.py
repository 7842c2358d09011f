"""Served benches for tests of faults: short procedures, every table language, TCP and terminals everywhere."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simrack.serve import Control
from simrack_tests.ports import free_port

from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

__all__ = ["RATE_DEG_S", "ROLES", "SPEED", "Physics", "Served", "bench_text", "serving"]

ROLES = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table")
SPEED = dict.fromkeys(("acl", "zaber", "atl", "esp", "dd16", "mn_as"), 8.0) | {"ruya": 1.0, "aaaa": 1.0}
"""Bench seconds a wall second: tables whose rate follows from angles are believed at their own speed only."""

SETTLE_BENCH_S = 0.7
"""Until the modes have rung down after the largest step: at 0.4 s 13 mV were left of them, of either sign."""

RATE_DEG_S = dict.fromkeys(("acl", "zaber", "atl", "esp", "dd16", "mn_as", "ruya"), 200.0) | {"aaaa": 20.0}
"""The rate at which faults strike; the table of `aaaa` turns to and fro only."""

# 12 deg/s are 0.08 V of V_Vc: at 0.1 V the simulated generator changes its range, with another error in each
_PROCEDURE = """
[procedure]
rates_deg_s = [{rate}, 0, -10]
match_rate_deg_s = 12
acceleration_deg_s2 = 1000
settle_s = {settle_s}
sample_interval_s = 0.1
samples = 2
nplc = 1
{tolerance}
[procedure.drive]"""


def bench_text(dialect: str, *, name: str, timeout_s: float = 1.0) -> str:
    """Return a bench file with few rates and few samples, its table speaking `dialect`."""
    said = f'dialect = "{dialect}"\ntimeout_s = {timeout_s}'
    if dialect == "zaber":
        said += "\nsteps_per_deg = 1777.7777777777778"
    tolerance = "rate_tolerance_deg_s = 5" if dialect in {"ruya", "aaaa"} else ""
    text = embedded_text("paper").replace('name = "paper"', f'name = "{name}"').replace('dialect = "acl"', said)
    for role in ("E3631A", "33220A", "34401A", "DSO7104B"):
        text = text.replace(f'model = "{role}"', f'model = "{role}"\ntimeout_s = {timeout_s}')
    text = text.replace("max_acceleration_deg_s2 = 200", "max_acceleration_deg_s2 = 1000")
    procedure = _PROCEDURE.format(
        rate=RATE_DEG_S[dialect], settle_s=SETTLE_BENCH_S / SPEED[dialect], tolerance=tolerance
    )
    return text.replace("\n[procedure.drive]", procedure)


@dataclass(frozen=True, slots=True)
class Physics:
    """What is really there, whatever instruments say."""

    rate_deg_s: float
    v_vc_v: float
    positive_v: float
    negative_v: float

    @property
    def at_rest(self) -> bool:
        """Whether the table stands."""
        return abs(self.rate_deg_s) < 0.05

    @property
    def off(self) -> bool:
        """Whether no output is on."""
        return abs(self.v_vc_v) < 0.01 and self.positive_v < 0.5 and self.negative_v > -0.5

    @property
    def safe(self) -> bool:
        """Whether nothing turns and nothing is on."""
        return self.at_rest and self.off


@dataclass(frozen=True, slots=True)
class Served:
    """A bench that another process serves: its wires, its physics, and the bench files that lead to it."""

    text: str
    wires: Mapping[str, Mapping[str, str | None]]
    control: Control
    port: int

    def physics(self) -> Physics:
        """Look at what is really there."""
        names = ("applied_rate_deg_s", "node.v_vc", "rail.positive.voltage_v", "rail.negative.voltage_v")
        return Physics(*(float(self.control.request("get", name=name)) for name in names))

    def look(self, name: str) -> float:
        """Look at one quantity."""
        return float(self.control.request("get", name=name))

    def reset(self) -> None:
        """Put the bench back to what it was first."""
        self.control.request("reset")

    def bench_file(self, resources: Mapping[str, str], *, lockstep: bool = False) -> str:
        """Return a bench file whose roles are at `resources`: of a bench on the wall clock, unless a run shall lead."""
        text = self.text.split("\n[simulation]")[0]
        for role, resource in resources.items():
            head, table, rest = text.partition(f"[{role}]\n")
            first, _, others = rest.partition("\nresource = ")
            pause = "\nserial_pause_s = 0.0" if resource.startswith("ASRL") else ""
            text = f'{head}{table}{first}\nresource = "{resource}"{pause}\n{others.partition(chr(10))[2]}'
        return text + (f'\n[served]\ncontrol = "127.0.0.1:{self.port}"\n' if lockstep else "")

    def resources(self, wires: str) -> dict[str, str]:
        """Return the resource of each role on ``tcp`` or ``pty``."""
        return {role: str(self.wires[role][wires]) for role in ROLES}


@contextmanager
def serving(folder: Path, text: str, *, speed: float | str) -> Iterator[Served]:
    """Serve the bench of a bench file's text in another process, every instrument on TCP and a terminal."""
    bench, complaints = folder / "bench.toml", folder / "server.txt"
    bench.write_text(text, encoding="utf-8")
    process, announced = _started(bench, speed, complaints)
    with process:
        try:
            port = int(announced["control"]["port"])
            with Control(port) as control:
                yield Served(text, announced["instruments"], control, port)
        finally:
            process.terminate()


def _started(bench: Path, speed: float | str, complaints: Path) -> tuple[subprocess.Popen[str], dict[str, Any]]:
    """Start the server on a free port, on another when somebody else was quicker to take it."""
    offers = [word for role in ROLES for word in ("--offer", f"{role}:tcp,pty")]
    for _ in range(5):
        words = ["--bench", str(bench), "--speed", str(speed), "--control-port", str(free_port()), "--json", *offers]
        with complaints.open("w") as stderr:
            process = subprocess.Popen(  # noqa: S603 - our own command
                [sys.executable, "-m", "vcfbench", "sim", "serve", *words],
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
            )
        assert process.stdout is not None
        if line := process.stdout.readline():
            return process, json.loads(line)
        with process:
            process.wait()
    raise RuntimeError(f"no bench is served: {complaints.read_text()}")
