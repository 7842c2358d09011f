"""Runs and conversations whose bytes stay the same until somebody changes them on purpose."""

from __future__ import annotations

import hashlib
import platform
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

import vcfbench
from tests.cli.test_run_served import QUICK
from tests.conformance import walk
from tests.conformance.test_exchanges import act
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.records.export import result_text
from vcfbench.records.plain import plain
from vcfbench.station.file import embedded_text
from vcfbench.testing.gyroscopes import drawn_bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

HASHES = Path(__file__).with_name("hashes.json")

SETTINGS: dict[str, dict[str, Any]] = {
    "turntable": {},
    "virtual-coriolis": {},
    "zero": {},
    "kvc": {},
    "warmup": {},
    "bandwidth": {},
    "power": {},
    "repeatability": {"power_cycles": 3, "off_s": 600.0},
    "rate-limits": {"warm_up_s": 60.0, "samples": 4},
    "threshold": {"at_most_s": 60.0},
    "g-sensitivity": {},
    "resonance": {},
    "phase": {},
    "temperature": {},
    "self-calibration": {"k_vc": "150"},
    "electrical": {},
    "polarity": {},
    "vibration": {},
    "online": {"k_vc": "150"},
}
"""The procedures, and the settings that they do not run without; `characterize` is made of them."""

BENCHES = {"vibration": ("lab",)}
MANY = ("turntable", "virtual-coriolis", "self-calibration", "polarity")
"""Procedures that take less than a second: they have three seeds on both benches, the others one on the ideal one."""
DRAWN = {
    **dict.fromkeys(("turntable", "virtual-coriolis", "polarity"), range(4)),
    "kvc": range(2),
    "bandwidth": range(2),
}
"""Procedures on drawn gyroscopes, by the seeds of these."""
DRAWN_BENCH = "gyroscope"
MODELS = (*walk.MODELS, *walk.SUCCESSORS)
WIRED = ("turntable", "virtual-coriolis", "polarity")
WIRES = ("tcp", "pty", "vxi11", "hislip")


@dataclass(frozen=True)
class GoldenRun:
    """One run on an embedded bench, or on that of a drawn gyroscope."""

    procedure: str
    bench: str
    seed: int

    @property
    def key(self) -> str:
        """Its name in the file of hashes."""
        return f"{self.procedure} {self.bench} {self.seed}"

    def hashes(self) -> dict[str, str]:
        """Run it; return the hashes of its points, of what its steps saw, and of its results."""
        drawn = self.bench == DRAWN_BENCH
        bench = parse_bench(drawn_bench(self.seed), f"gyroscope-{self.seed}") if drawn else self.bench
        with TemporaryDirectory() as folder:
            run = vcfbench.run(self.procedure, bench, seed=self.seed, settings=SETTINGS[self.procedure], runs=folder)
            return hashes_of_record(run.directory)


def hashes_of_record(directory: Path) -> dict[str, str]:
    """Return the hashes of ``points.csv``, of the steps with their answers, and of the results of a record."""
    lines = [msgspec.json.decode(line) for line in (directory / "journal.jsonl").read_bytes().splitlines()]
    seen = [{name: line[name] for name in line if name not in ("utc", "seal")} for line in lines[1:-1]]
    results = vcfbench.load_run(directory).results
    return {
        "points": _digest((directory / "points.csv").read_bytes()),
        "steps": _digest(*map(msgspec.json.encode, seen)),
        "results": _digest(result_text(plain(results)).encode()),
    }


RUNS = [
    GoldenRun(procedure, bench, seed)
    for procedure in SETTINGS
    for bench in BENCHES.get(procedure, ("paper", "ideal") if procedure in MANY else ("ideal",))
    for seed in range(3 if procedure in MANY else 1)
] + [GoldenRun(procedure, DRAWN_BENCH, seed) for procedure, seeds in DRAWN.items() for seed in seeds]


def replies_hash(model: str) -> str:
    """Return the hash of every reply of an instrument to its expectation file: all questions, all short exchanges."""
    said = hashlib.sha256()
    with _recorded(said.update):
        for _, command in walk.commands(model):
            for message, question in _questions(command):
                bench = walk.bench(model)
                for sent in (*command.arrange, *message):
                    bench.write(sent)
                bench.ask(question)
        for exchange in walk.load(model)["exchange"]:
            if not exchange.get("long"):
                bench = walk.bench(model, exchange.get("interface", "gpib"))
                for step in exchange["talk"]:
                    act(bench, step, step)
    return said.hexdigest()[:16]


def _questions(command: walk.Command) -> Iterator[tuple[list[str], str]]:
    """Yield what is sent first, and the question then."""
    if command.question is not None and (command.reset is not None or command.reply is not None):
        yield [], command.question
    for argument, _ in command.asks:
        yield [], f"{command.plain}? {argument}"
    if then := command.readback or command.question:
        for argument, *_ in (*command.accepts, *command.clips):
            yield [f"{command.plain} {argument}".rstrip()], then


@contextmanager
def _recorded(tell: Callable[[bytes], None]) -> Iterator[None]:
    """Let `tell` have each response that a :class:`walk.Bench` reads, or that there was none."""
    read = walk.Bench.read

    def told(self: walk.Bench, *arguments: Any) -> str | None:
        answer = read(self, *arguments)
        tell(b"nothing\n" if answer is None else answer.encode("latin-1") + b"\n")
        return answer

    walk.Bench.read = told  # type: ignore[method-assign]
    try:
        yield
    finally:
        walk.Bench.read = read  # type: ignore[method-assign]


def wired_bench(folder: Path, bench: str) -> Path:
    """Write an embedded bench with few quick points, for runs over wires."""
    path = folder / f"{bench}.toml"
    path.write_text(embedded_text(bench).replace("\n[procedure.drive]", QUICK), encoding="utf-8")
    return path


def wired_hashes(procedure: str, bench: Path | str, seed: int | None = 7) -> dict[str, str]:
    """Run `procedure` on the quick bench; return its hashes, which are those over any wire. None is a served bench."""
    with TemporaryDirectory() as folder:
        run = vcfbench.run(procedure, bench, seed=seed, runs=folder)
        return hashes_of_record(run.directory)


def _wired(procedure: str, bench: str) -> dict[str, str]:
    with TemporaryDirectory() as folder:
        return wired_hashes(procedure, wired_bench(Path(folder), bench))


def jobs() -> dict[str, dict[str, Callable[[], Any]]]:
    """Return all that has hashes: by section of the file, by key, what makes them."""
    wired = {f"{name} {bench}": partial(_wired, name, bench) for name in WIRED for bench in ("paper", "ideal")}
    return {
        "replies": {model: partial(replies_hash, model) for model in MODELS},
        "wired": wired,
        "runs": {run.key: run.hashes for run in RUNS},
    }


def arithmetic() -> dict[str, str]:
    """Return what the last digits depend on: libraries, interpreter, C library, instruction sets."""
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    return {
        "numpy": metadata.version("numpy"),
        "scipy": metadata.version("scipy"),
        "python": ".".join(platform.python_version_tuple()[:2]),
        "libc": " ".join(platform.libc_ver()),
        "machine": " ".join([platform.machine(), *simd["baseline"], *simd["found"]]),
    }


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"\n".join(parts)).hexdigest()[:16]
