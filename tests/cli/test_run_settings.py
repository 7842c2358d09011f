"""Settings on the command line, help that lists them, and procedures of one's own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from vcfbench.cli.main import app
from vcfbench.cli.set_option import asked_by_command
from vcfbench.errors import ConfigError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.keys import settable_keys
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings

if TYPE_CHECKING:
    from typer.testing import Result

HYSTERESIS = Path(__file__).parents[2] / "examples" / "own-procedure" / "hysteresis.py"


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["run", *arguments])


def refusal(*arguments: str) -> str:
    done = call("virtual-coriolis", "--dry-run", *arguments)
    assert (done.exit_code, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    return line.removeprefix("vcfbench: ")


def sets(*given: str) -> list[str]:
    return [word for each in given for word in ("--set", each)]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["samples=1"], "--set samples: expected a whole number at least 2 and at most 1000000, got 1"),
        (["samples=ten"], "--set samples: expected a whole number at least 2 and at most 1000000, got 'ten'"),
        (["sample=3"], "--set sample: expected a known key ('samples'?), got an unknown key"),
        (["drive.start_up_s=1e9"], "--set drive.start_up_s: expected a number at least 0.01 and at most 600"),
        (["drive.start=1"], "--set drive.start: expected a known key ('start_up_s'?), got an unknown key"),
        (["drive=3"], "--set drive: expected a table, got 3"),
        (["rates_deg_s=0,400,3"], "--set rates_deg_s[1]: expected a rate of at most 300 deg/s either way"),
        (["rates_deg_s=0,fast,3"], "--set rates_deg_s: expected a list of 3 to 1000 numbers, got '0,fast,3'"),
        (["rates_deg_s=0:5:2"], "--set rates_deg_s: expected START:STOP:STEP, whole steps from start to stop"),
        (["rates_deg_s=5:0:1"], "--set rates_deg_s: expected START:STOP:STEP, whole steps from start to stop"),
        (["rates_deg_s=0:1:0"], "--set rates_deg_s: expected START:STOP:STEP, whole steps from start to stop"),
        (["rates_deg_s=0:1e9:1"], "--set rates_deg_s: expected START:STOP:STEP, whole steps from start to stop"),
        (["settle_s=nan"], "--set settle_s: expected a number at least 0.01 and at most 3600, got 'nan'"),
        (["samples=3\nnplc = 1"], "--set samples: expected a whole number at least 2"),
        (["samples"], "--set samples: expected KEY=VALUE, as in --set samples=20"),
        (["=3"], "--set =3: expected KEY=VALUE"),
        (["drive.=3"], "--set drive.=3: expected KEY=VALUE"),
        (["samples=3", "samples=4"], "--set samples=4: samples is given twice"),
        (["drive=3", "drive.start_up_s=4"], "--set drive.start_up_s=4: drive is given twice"),
        (["station=3"], "--set station: expected one of"),
        (["nplc=100"], "paper: procedure.sample_interval_s: expected at least 4 s"),
    ],
)
def test_unknown_setting_is_one_line_with_option(given: list[str], said: str) -> None:
    assert refusal(*sets(*given)).startswith(said)


def test_a_text_that_reads_as_a_number_is_a_text() -> None:
    asked = asked_by_command(["k_vc=150", "dut='7'", "samples=3"], {}, {}, texts={"k_vc", "dut"})
    assert asked.values == {"k_vc": "150", "dut": "7", "samples": 3}


def test_a_range_has_both_its_ends_and_its_decimals() -> None:
    asked = asked_by_command(["a=-200,-0.2:0.2:0.1,200", "b=10:50:20", "c=10:50:20"], {}, {}, texts={"c"})
    assert asked.values == {"a": [-200.0, -0.2, -0.1, 0.0, 0.1, 0.2, 200.0], "b": [10.0, 30.0, 50.0], "c": "10:50:20"}


def test_rates_and_samples_are_options_of_every_run() -> None:
    shown = CliRunner().invoke(
        app, ["run", "turntable", "--rates", "-5:5:0.5", "--samples", "3", "--dry-run", "--json"]
    )
    assert shown.exit_code == 0
    assert shown.stdout.count("table to ") >= 21
    assert refusal("--rates", "5:1:1").startswith("--rates: expected START:STOP:STEP")


def test_bytes_of_another_encoding_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"--set 'order=.*': expected UTF-8"):
        asked_by_command(["order=p\udcfc"], {}, {})


def test_an_option_that_stands_for_a_key_is_named_itself() -> None:
    assert refusal("--match", "nearly") == "--match: expected 'zero' or 'absolute', got 'nearly'"
    assert refusal("--match", "zero", *sets("match=zero")) == "--set match=zero: match is given twice"


@pytest.mark.exhaustive
def test_options_may_be_called_otherwise_than_their_keys() -> None:
    """A key called like a procedure would make ``[procedure.zero]`` both; a truth value needs no word."""
    asked = ["--order", "abba", "--zero", "bracket", "--repeat", "2", "--kvc", "plus-minus"]
    shown = " ".join(call("virtual-coriolis", "--dry-run", *asked).stdout.split())
    assert "order abba, a zero before and after each rate, 2 times" in shown
    assert "Cycle 2, 10 deg/s: table at rest, V_Vc on" in shown
    assert refusal("--zero", "both") == "--zero: expected 'none' or 'ends' or 'bracket', got 'both'"
    assert refusal("--kvc", "two").startswith("--kvc: expected 'one-point' or 'plus-minus' or 'curve'")


def test_zero_table_of_bench_file_sets_no_other_procedure(tmp_path: Path) -> None:
    bench = tmp_path / "lab.toml"
    text = Path(__file__).parents[2].joinpath("examples", "ideal-bench.toml").read_text("utf-8")
    own = "[procedure.zero]\nduration_s = 600.0\n[procedure.turntable]\nzeros = 'ends'\n[procedure.drive]"
    bench.write_text(text.replace("[procedure.drive]", own), "utf-8")
    assert "a zero before and after each series" in call("turntable", "--bench", str(bench), "--dry-run").stdout


def test_a_bench_file_gives_way_to_the_command_line(tmp_path: Path) -> None:
    bench = tmp_path / "lab.toml"
    text = Path(__file__).parents[2].joinpath("examples", "ideal-bench.toml").read_text("utf-8")
    own = '[procedure]\nsamples = 3\n[procedure.virtual-coriolis]\nmatch = "absolute"\n[procedure.drive]'
    bench.write_text(text.replace("[procedure.drive]", own), "utf-8")
    command = ["virtual-coriolis", "--bench", str(bench), "--json", "--quiet", "--runs", str(tmp_path)]
    answer = json.loads(call(*command, *sets("rates_deg_s = 10, 0, -10", "samples=4")).stdout)
    assert {point["n"] for point in answer["points"]} == {4}
    assert answer["results"]["match"] == "absolute"
    (journal,) = tmp_path.glob("*/journal.jsonl")
    header = json.loads(journal.read_text("utf-8").splitlines()[0])
    assert header["options"]["settings"] == {"rates_deg_s": [10, 0, -10], "samples": 4}
    assert (header["title"], header["settings"]["match"]) == (
        "Calibrate by the paper's four steps: on the rate table and by the virtual Coriolis force.",
        "absolute",
    )


def test_help_has_every_key_with_default_range_and_meaning() -> None:
    shown = " ".join(call("virtual-coriolis", "--help").stdout.split())
    assert "readings per mean: a whole number at least 2 and at most 1000000; default 10" in shown
    assert "a list of 3 to 1000 numbers, each at least -5000 and at most 5000; default [200.0, 100.0," in shown
    assert "--match zero|absolute" in shown
    assert all(f" {key.path} {key.meaning}" in shown for key in settable_keys(VirtualCoriolisSettings))
    assert "--match" not in call("turntable", "--help").stdout


def test_texts_of_a_list_may_do_without_brackets_and_quotes() -> None:
    shown = call("power", "--dry-run", "--set", 'orders=["together", "positive"]').stdout
    for said in ("together,positive", " together , positive", "['together', 'positive']"):
        assert call("power", "--dry-run", "--set", f"orders={said}").stdout == shown, said
    refused = call("power", "--dry-run", "--set", "orders=left")
    assert refused.exit_code == 2
    assert "--set orders[0]: expected 'negative' or 'positive' or 'together', got 'left'" in refused.stderr


def test_help_of_an_option_leaves_symbols_as_they_are_written() -> None:
    shown = " ".join(call("self-calibration", "--help").stdout.split())
    assert "A certificate's file, or (deg/s)/V as a number;" in shown
    assert "V_Vc is measured" in shown
    assert "V_vc" not in shown
    assert "K_vc" not in call("virtual-coriolis", "--help").stdout


def test_a_list_of_the_procedures_imports_none() -> None:
    code = (
        "import sys; from typer.testing import CliRunner; from vcfbench.cli.main import app\n"
        "done = CliRunner().invoke(app, ['run', '--help']); print(done.stdout)\n"
        "heavy = ('numpy', 'pyvisa', 'vcfbench.procedures.turntable')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    shown = " ".join(done.stdout.split())
    for name, title in BUILT_IN.items():
        assert f"{name} {title}" in shown
        assert PROCEDURES[name].title == title
    assert shown.endswith("[]")


# --- files of one's own ---


@pytest.mark.exhaustive
def test_a_file_is_run_like_a_name(tmp_path: Path) -> None:
    settings = sets("rates_deg_s=0,50,100", "samples=3", "loops=2")
    done = call(str(HYSTERESIS), "--json", "--quiet", "--runs", str(tmp_path), *settings)
    answer = json.loads(done.stdout)
    assert (done.exit_code, answer["procedure"], len(answer["points"])) == (0, "hysteresis", 12)
    assert list(answer["results"]) == ["rates_deg_s", "width_v"]
    shown = CliRunner().invoke(app, ["runs", "show", "last", "--runs", str(tmp_path)])
    assert "the procedure 'hysteresis' is not known here" in shown.stdout


def test_the_help_of_a_file_begins_with_its_own_keys() -> None:
    shown = " ".join(call(str(HYSTERESIS), "--help").stdout.split())
    assert "Measure the output at each rate on the way up" in shown
    assert "loops times up and down: a whole number at least 1 and at most 100; default 1 positive_rail_v" in shown


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "expected a procedure's file, there is no such file"),
        ("x = 1\ny = \n", "line 2: SyntaxError"),
        ("import vcfbench\nvcfbench.nothing\n", "line 2: AttributeError"),
        ("", "expected a file with one Procedure, got none"),
    ],
)
@pytest.mark.parametrize("more", [[], ["--help"], ["--dry-run"]])
def test_a_broken_file_is_one_sentence_and_exit_code_two(
    text: str | None, said: str, more: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "own.py"
    if text is not None:
        path.write_text(text, "utf-8")
    done = call(str(path), *more)
    assert (done.exit_code, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert str(path) in line
    assert said in line


def test_mistakes_while_the_plan_is_walked_have_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(HYSTERESIS.read_text("utf-8").replace("yield vb.Note(", "yield vb.Nota("), "utf-8")
    done = call(str(path), "--quiet", "--runs", str(tmp_path / "runs"))
    assert done.exit_code == 2
    assert f"the procedure 'hysteresis' has a mistake: {path}, line 31: AttributeError" in done.stderr
    assert "Traceback" not in done.output


def test_a_file_whose_name_is_taken_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "own.py"
    path.write_text(HYSTERESIS.read_text("utf-8").replace('name="hysteresis"', 'name="turntable"'), "utf-8")
    done = call(str(path), "--dry-run")
    assert done.exit_code == 2
    assert "own.py: its procedure is called 'turntable', a name taken by vcfbench itself" in done.stderr


@pytest.mark.parametrize(
    ("command", "option", "values"),
    [
        (["analyze", "log.csv"], "--unit", ["gyro=dps", "gyro=mdps"]),
        (["analyze", "log.csv"], "--unit", ["dps", "mdps"]),
        (["report", "last"], "--set", ["customer=A", "customer=B"]),
        (["runs", "amend", "last", "--reason", "label"], "--set", ["dut=G-1", "dut=G-2"]),
        (["bench", "new", "x.toml"], "--set", ["limits.max_rate_deg_s=1", "limits.max_rate_deg_s=2"]),
        (["runs", "list"], "--tag", ["lot=1", "lot=2"]),
    ],
)
def test_key_given_twice_to_an_option_is_refused(command: list[str], option: str, values: list[str]) -> None:
    done = CliRunner().invoke(app, [*command, *(word for each in values for word in (option, each))])
    assert done.exit_code == 2
    assert f"{option} {values[1]}: " in done.stderr
    assert "is given twice" in done.stderr
