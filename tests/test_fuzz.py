"""Files and messages that are nearly right: every reader says one sentence, every wire goes on.

``VCFBENCH_FUZZ_S=200 pytest tests/test_fuzz.py`` takes so long for each reader and wire, in seconds: an hour for all.
A failure names its seed; ``VCFBENCH_FUZZ_SEED`` is the first one.
"""

from __future__ import annotations

import os
import re
import shutil
from contextlib import suppress
from itertools import count
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few

import vcfbench
from tests.records.test_devices import CERTIFICATE
from tests.sim.serve.test_attacks import call, caller, hislip, require_well, sent, served
from vcfbench.archive.run import Run
from vcfbench.archive.verified import verify_run
from vcfbench.clock import WallClock
from vcfbench.drivers.trace import HEADER
from vcfbench.errors import ConfigError, PlanError
from vcfbench.records.devices import DeviceStore, read_entry
from vcfbench.records.journal import read_journal
from vcfbench.runs.batch import read_batch
from vcfbench.sim.fault_scripts import read_script
from vcfbench.station.file import read_bench
from vcfbench.station.meter_dcc import read_meter_dcc
from vcfbench.studies.file import read_study
from vcfbench.testing.replay import read_trace
from vcfbench_tables.profile import load_profile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from simrack_tests.serve.lamp import Served

__all__ = ["served"]

SECONDS = float(os.environ.get("VCFBENCH_FUZZ_S", "0.3"))
FIRST = int(os.environ.get("VCFBENCH_FUZZ_SEED", "0"))
EXAMPLES = Path(__file__).parents[1] / "examples"
ODD = (b"\x00", b"\xff", b"\xed\xa0\x80", b"\r", b"\n", b'"', b"'", b"[", b"{", b"<", b"&", b"#", b"=", b"nan", b"-inf")
NUMBER = re.compile(rb"[0-9.]+")
NUMBERS = (b"1e999", b"-1", b"0", b"1e-320", b"9" * 400, b"0x10", b"1_0", b"true", b"NaN", b"2.5", b"-0.0", b"\xd9\xa3")


def mutated(data: bytes, random: Random) -> bytes:
    """Return `data` with up to four places changed."""
    for _ in range(random.randint(1, 4)):
        at = random.randrange(len(data) + 1)
        end = min(len(data), at + random.choice((1, 1, 2, 8, 64, 1000)))
        lines = data.split(b"\n")
        match random.randrange(7):
            case 0:
                data = data[:at] + bytes([random.randrange(256)]) + data[at + 1 :]
            case 1:
                data = data[:at] + data[end:]
            case 2:
                data = data[:at] + data[at:end] * random.choice((2, 2, 50)) + data[end:]
            case 3:
                data = data[:at] + random.choice(ODD) + data[at:]
            case 4:
                one, other = random.randrange(len(lines)), random.randrange(len(lines))
                lines[one], lines[other] = lines[other], lines[one]
                data = b"\n".join(lines)
            case 5:
                if number := NUMBER.search(data, at):
                    data = data[: number.start()] + random.choice(NUMBERS) + data[number.end() :]
            case _:
                data = data[:at]
    return data


def seeds() -> Iterator[int]:
    clock = WallClock()
    for seed in count(FIRST):
        yield seed
        if clock.now() > SECONDS:
            return


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a record, an entry of a device, a batch, a study, a trace and a script of faults."""
    folder = tmp_path_factory.mktemp("fuzz")
    quick = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
    run = vcfbench.run("turntable", settings=quick, runs=folder / "runs")
    assert run.directory is not None
    shutil.copytree(run.directory, folder / "record")
    shutil.copy(DeviceStore(folder / "devices").add(CERTIFICATE).path, folder / "entry.json")
    (folder / "batch.toml").write_text('name = "a"\nbench = "paper"\ndevices = ["G-1"]\n[[runs]]\nprocedure = "zero"\n')
    shutil.copy(EXAMPLES / "studies" / "readings.toml", folder / "study.toml")
    shutil.copy(EXAMPLES / "lab-tests" / "faults" / "overload.toml", folder / "faults.toml")
    (folder / "trace.txt").write_text(f"{HEADER}\n0.5\tpower\tGPIB0::5::INSTR\t>\t*IDN?\\n\n")
    return folder


def looked_at(path: Path) -> None:
    """Read a record as lists and reports do."""
    run = vcfbench.load_run(path.parent)
    assert isinstance(run, Run)
    run.report()


def _verified(path: Path) -> None:
    verify_run(path.parent)


READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "bench file": ("paper-bench.toml", read_bench),
    "table profile": ("own-table/table.toml", lambda path: load_profile(str(path))),
    "certificate of a meter": ("34401A-certificate.xml", read_meter_dcc),
    "table of points": ("paper-table1.csv", vcfbench.analyze),
    "script of faults": ("faults.toml", read_script),
    "study": ("study.toml", read_study),
    "batch": ("batch.toml", read_batch),
    "trace": ("trace.txt", read_trace),
    "entry of a device": ("entry.json", read_entry),
    "journal": ("record/journal.jsonl", read_journal),
    "journal, reported": ("record/journal.jsonl", looked_at),
    "journal, verified": ("record/journal.jsonl", _verified),
    "results, verified": ("record/result.json", _verified),
}


@pytest.mark.parametrize("name", few(READERS, every=4))
def test_nearly_right_file_is_read_or_refused_in_a_sentence(name: str, written: Path, tmp_path: Path) -> None:
    place, read = READERS[name]
    source = written / place if (written / place).exists() else EXAMPLES / place
    data = source.read_bytes()
    path = tmp_path / source.name
    for other in source.parent.iterdir() if place.startswith("record/") else ():
        if other.is_file():
            shutil.copy(other, tmp_path / other.name)
    for seed in seeds():
        path.write_bytes(mutated(data, Random(f"{name}/{seed}")))  # noqa: S311  # no secrets
        try:
            read(path)
        except (ConfigError, PlanError) as error:
            assert "\n" not in str(error), (name, seed)  # noqa: PT017  # either outcome is right
        except Exception as error:
            error.add_note(f"VCFBENCH_FUZZ_SEED={seed}: {name}")
            raise


SESSIONS = {
    "tcp": b"*IDN?\nDIM 0.5;DIM?;*ESE 1;*STB?\nSYST:ERR?\n#15hello\n" * 3,
    "vxi11": call(1, 10, bytes(12) + b"\0\0\0\5inst0\0\0\0")
    + call(2, 11, b"\0\0\0\1" + b"\0\0\x10\0" * 2 + b"\0\0\0\x08\0\0\0\6*IDN?\n\0\0")
    + call(3, 12, b"\0\0\0\1" * 6),
    "hislip": hislip(0, 0x0100_7878, b"hislip0") + hislip(7, 0xFFFF_FF00, b"*IDN?\n") + hislip(6, 2, b"DIM?\n"),
    "control": b'{"do": "list"}\n{"do": "now", "id": 1}\n{"do": "fault", "instrument": "table", "kind": "silent", '
    b'"duration_s": 0.1}\n{"do": "set", "name": "ambient_c", "value": 30}\n',
}


@pytest.mark.parametrize("kind", few(SESSIONS, every=2))
def test_a_conversation_that_is_nearly_right_holds_nobody_up(
    kind: str, served: Served, capfd: pytest.CaptureFixture[str]
) -> None:
    for seed in seeds():
        with caller(served, kind) as connection:
            sent(connection, mutated(SESSIONS[kind], Random(f"{kind}/{seed}")))  # noqa: S311  # no secrets
            connection.settimeout(0.02)
            with suppress(OSError):
                connection.recv(65536)
        if seed % 20 == 0:
            require_well(served)
        assert capfd.readouterr().err == "", f"VCFBENCH_FUZZ_SEED={seed}: {kind}"
    require_well(served)
