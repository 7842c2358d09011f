"""The command `vcfbench study`: what it prints where, and how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

from tests import warm

if TYPE_CHECKING:
    from pathlib import Path

STUDY = """
procedure = "turntable"
seeds.count = 2
settings = { rates_deg_s = [10, 0, -10], samples = 3, settle_s = 0.5 }
metrics = ["bias"]
[vary]
settings.samples = { values = [3, 4], label = "readings" }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "s.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path


def study(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return warm.run(["vcfbench", "study", "s.toml", *words], folder)


@pytest.mark.exhaustive
def test_a_dry_run_lists_cases_and_writes_nothing(folder: Path) -> None:
    done = study(folder, "--dry-run", "-o", "x.csv", "--workers", "4")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split() for line in lines[:4]] == [["case", "readings"], [lines[1]], ["0", "3"], ["1", "4"]]
    assert lines[5] == "2 cases, seeds 0 to 1: 4 runs of turntable, 0 of them done"
    assert "with 4 processes" in lines[6]
    assert [path.name for path in folder.iterdir()] == ["s.toml"]


@pytest.mark.exhaustive
def test_stdout_has_json_only_and_stderr_progress(folder: Path) -> None:
    done = study(folder, "-o", "x.csv", "--workers", "1", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert [case["values"] for case in answer["cases"]] == [{"readings": 3}, {"readings": 4}]
    assert answer == json.loads((folder / "x.summary.json").read_text("utf-8"))
    assert done.stderr.splitlines()[0] == "4 runs"
    assert done.stderr.splitlines()[-1].startswith("4 of 4 runs, 0 s left")
    quiet = study(folder, "-o", "x.csv", "--quiet")
    assert quiet.stderr == ""
    assert quiet.stdout.splitlines()[-3:] == ["table: x.csv", "summary: x.summary.json", "picture: x.svg"]
    planned = json.loads(study(folder, "-o", "x.csv", "--dry-run", "--json", "--quiet").stdout)
    assert (planned["runs"], planned["done"], planned["left_s"]) == (4, 4, 0.0)


@pytest.mark.parametrize(
    ("change", "words", "code"),
    few(
        [
            ("settle_s = 0.5", "s.toml: settings.settle_s: expected a number", 2),
            ("values = [3, 4]", "s.toml: vary.settings.samples: expected a whole number at least 2", 2),
            ('"turntable"', "there is no procedure '1'", 2),
        ],
        ("values = [3, 4]", "s.toml: vary.settings.samples: expected a whole number at least 2", 2),
    ),
)
def test_a_mistake_is_one_sentence(folder: Path, change: str, words: str, code: int) -> None:
    wrong = {"settle_s = 0.5": "settle_s = -1.0", "values = [3, 4]": "values = [3, 1]", '"turntable"': '"1"'}[change]
    (folder / "s.toml").write_text(STUDY.replace(change, wrong), encoding="utf-8")
    done = study(folder, "-o", "x.csv")
    assert done.returncode == code
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert not (folder / "x.journal.jsonl").exists()


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("workers", ["2"])
def test_stopped_study_names_kept_runs_and_continues(folder: Path, workers: str) -> None:
    (folder / "s.toml").write_text(STUDY.replace("count = 2", "count = 500"), encoding="utf-8")
    command = [sys.executable, "-m", "vcfbench", "study", "s.toml", "-o", "x.csv", "--workers", workers]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, process_group=0) as process:  # noqa: S603
        assert process.stderr is not None
        while "of 1000 runs" not in process.stderr.readline():
            assert process.poll() is None
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to all of them
        words = process.communicate(timeout=60.0)[1]
    assert process.returncode == 4
    assert "runs are kept in x.journal.jsonl; the same command goes on" in words
    assert words.rstrip().endswith("vcfbench: stopped by SIGINT")
    assert "Traceback" not in words
    assert (folder / "x.journal.jsonl").read_bytes().endswith(b"\n")
    assert not (folder / "x.csv").exists()
