"""The kit that stands alone: what it writes of an instrument, what it leaves out, and how it ends."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from threading import Thread
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa

from tests.testing.kit.recording import library, recorded
from vcfbench.drivers.e3631a import E3631A
from vcfbench.testing import over_visa, read_trace, replay_trace
from vcfbench.testing.kit import program
from vcfbench.testing.kit.program import masked
from vcfbench.testing.kit.write import written

if TYPE_CHECKING:
    from pathlib import Path

SERIAL = "MY52701054"
WORDS = ["VOLT", "VOLTAGE", "CHAN", "ON", "NONE"]


@pytest.fixture(scope="module")
def kit() -> str:
    return written()


def test_program_is_one_file_of_500_lines_with_pyvisa_alone(kit: str) -> None:
    assert len(kit.splitlines()) <= 500
    imported = {
        name.partition(".")[0]
        for node in ast.walk(ast.parse(kit))
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [each.name for each in node.names])
        if name is not None
    }
    assert imported - sys.stdlib_module_names == {"pyvisa"}


def test_what_is_packed_into_it_is_unpacked_again(kit: str) -> None:
    names: dict[str, Any] = {"__name__": "kit"}
    exec(compile(kit, "kit.py", "exec"), names)  # noqa: S102  # as Python runs a file
    assert "VOLT:RANG?" in names["scripts"]()["34401A"]["reads"]


def test_kit_only_reads_unless_confirmed_twice(tmp_path: Path) -> None:
    recorded(tmp_path / "a.trace", "E3631A", driven=False)
    said = [line.data.decode().strip() for line in read_trace(tmp_path / "a.trace") if line.mark == ">"]
    assert all(each.endswith("?") for each in said)
    assert not program.twice("E3631A", {"does": ""}, lambda _: "y")


@pytest.mark.parametrize(
    ("question", "answer", "kept"),
    [
        (
            "*IDN?",
            f"Agilent Technologies,33522B,{SERIAL},3.05-1.19",
            "Agilent Technologies,33522B,XX00000000,3.05-1.19",
        ),
        ("*IDN?", "the box of A. Miller", "XXX XXX XX X. XXXXXX"),
        ("*IDN?", f"ACME,M1,{SERIAL},1.0 {SERIAL}", "ACME,M1,XX00000000,0.0 XX00000000"),
        ("*OPT?", "0,0", "0,0"),
        ("VOLT?", "+1.00000000E+01", "+1.00000000E+01"),
        ("FUNC?", '"VOLT +1.000000E+01"', '"VOLT +1.000000E+01"'),
        ("INP?", "CHAN1", "CHAN1"),
        ("SYST:SER?", "04592448", "00000000"),
        ("SYST:SER?", "1308", "1308"),
        ("DISP:TEXT?", '"lab 3, rack 12"', '"XXX 0, XXXX 00"'),
        ("SYST:COMM:LAN:IPAD?", '"169.254.2.20"', '"000.000.0.00"'),
        ("SYST:COMM:LAN:MAC?", '"00:30:D3:20:41:AA"', '"00:00:X0:00:00:XX"'),
        ("MMEM:CAT?", '"C:\\\\GYRO7\\\\RUN.CSV"', '"X:\\\\XXXX0\\\\XXX.XXX"'),
        ("SYST:DATE?", "2026,11,30", "0000,00,00"),
        ("CAL:TIME?", "16,4,59", "00,0,00"),
        ("SWE:TIME?", "+1.00000000E+00", "+1.00000000E+00"),
        ("CAL:STR?", '"2026-03-01 by A. Miller"', '"0000-00-00 XX X. XXXXXX"'),
        ("*LRN?", f"VOLT {SERIAL};ON", "VOLT XX00000000;ON"),
    ],
)
def test_kit_keeps_numbers_and_known_words_only(question: str, answer: str, kept: str) -> None:
    assert masked(question, answer, WORDS, SERIAL) == kept


def test_no_identity_is_left_in_a_bundle(tmp_path: Path) -> None:
    manager: Any = pyvisa.ResourceManager(library("33522B"))
    device = manager.open_resource(manager.list_resources("?*")[0])
    secrets = ("SERIAL77", "Miller", "gyro-lab", "10.11.12.13")
    for message in ("DISP:TEXT 'SERIAL77'", "CAL:STR 'Miller QX-7312'", "SYST:COMM:LAN:HOST 'gyro-lab'"):
        device.write(message)
    device.write("SYST:COMM:LAN:IPAD '10.11.12.13'")
    recorded(tmp_path / "a.trace", "33522B")
    text = (tmp_path / "a.trace").read_text()
    assert [each for each in (*secrets, *re.findall("MY[0-9]+", text), "QX-7312") if each in text] == []


def test_a_driver_can_be_opened_on_the_bundle(tmp_path: Path) -> None:
    recorded(tmp_path / "a.trace", "E3631A")
    with replay_trace(tmp_path / "a.trace", over_visa(E3631A), role="E3631A driven", whole=False) as supply:
        supply.configure_output("P6V", 1.0, 0.05)


@pytest.mark.parametrize("ending", [KeyboardInterrupt, ValueError])
def test_however_it_ends_outputs_are_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: type[BaseException]
) -> None:
    ask = program.Connection.ask

    def broken_off(self: program.Connection, question: str, wait_s: float) -> str | None:
        if question.startswith("MEAS:VOLT?"):
            raise ending
        return ask(self, question, wait_s)

    monkeypatch.setattr(program.Connection, "ask", broken_off)
    assert recorded(tmp_path / "a.trace", "E3631A") == {KeyboardInterrupt: 130, ValueError: 1}[ending]
    said = [line.data for line in read_trace(tmp_path / "a.trace") if line.mark == ">"]
    assert said[said.index(b"OUTP ON\n") :][-3:] == [b"OUTP OFF\n", b"*RST\n", b"*OPC?\n"]
    manager: Any = pyvisa.ResourceManager(library("E3631A"))
    assert manager.open_resource(manager.list_resources("?*")[0]).query("OUTP?").strip() == "0"


def test_it_is_made_safe_in_any_thread(tmp_path: Path) -> None:
    thread = Thread(target=recorded, args=(tmp_path / "a.trace", "E3631A"))
    thread.start()
    thread.join()
    assert [line.data for line in read_trace(tmp_path / "a.trace") if line.mark == ">"][-2:] == [b"*RST\n", b"*OPC?\n"]


def test_unknown_model_gets_common_queries(tmp_path: Path) -> None:
    monkey = program.scripts
    try:
        program.scripts = dict
        manager = pyvisa.ResourceManager(library("34401A"))
        words = [*manager.list_resources("?*"), "--library", library("34401A"), "--output", str(tmp_path / "a.trace")]
        assert program.main(words, lambda _: "n") == 0
    finally:
        program.scripts = monkey
    assert {line.role for line in read_trace(tmp_path / "a.trace")} == {"unknown"}


def test_a_file_that_is_there_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "a.trace").write_text("mine")
    assert recorded(tmp_path / "a.trace", "34401A") == 2
    assert (tmp_path / "a.trace").read_text() == "mine"


@pytest.mark.parametrize("chosen", ["7", "0", "-1", "1,2", "1.5", "1 7"])
def test_a_number_that_is_no_choice_is_asked_again(chosen: str, capsys: pytest.CaptureFixture[str]) -> None:
    given = iter([chosen, "2 ASRL3::INSTR@9600"])
    assert program.wanted(["a", "b"], lambda _: next(given)) == ["b", "ASRL3::INSTR@9600"]
    assert f"{chosen.removeprefix('1 ')}: not in the list" in capsys.readouterr().out


@pytest.mark.parametrize(("ending", "code"), [(KeyboardInterrupt, 130), (OSError("refused"), 1), (None, 1)])
def test_no_file_is_left_where_nothing_answered(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ending: type[BaseException] | OSError | None,
    code: int,
) -> None:
    def connect(_: program.Connection) -> None:
        if ending is not None:
            raise ending

    monkeypatch.setattr(program.Connection, "connect", connect)
    monkeypatch.chdir(tmp_path)
    resources = [] if ending is None else ["GPIB0::22::INSTR"]
    assert program.main([*resources, "--library", library("34401A")], lambda _: "") == code
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().out.splitlines()[-1] == "nothing answered: no file is written"


def test_bundle_tells_versions_and_no_date(tmp_path: Path) -> None:
    recorded(tmp_path / "a.trace", "34401A", driven=False)
    opened = read_trace(tmp_path / "a.trace")[0].data.decode()
    assert opened == f"gpib pyvisa {pyvisa.__version__}, pyvisa_simrack"


@pytest.mark.exhaustive
def test_the_written_file_runs_by_itself(tmp_path: Path, kit: str) -> None:
    (tmp_path / "kit.py").write_text(kit)
    words = [sys.executable, "kit.py", "--library", library("34401A")]
    done = subprocess.run(words, cwd=tmp_path, input="1\nn\n", text=True, capture_output=True, check=False)  # noqa: S603
    assert done.returncode == 0, done.stderr
    assert len(read_trace(tmp_path / "vcfbench-bundle.trace")) > 200
