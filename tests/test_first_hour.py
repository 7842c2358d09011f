"""What docs/howto/first-hour.md has typed can be typed: on the simulated bench, where it breaks nothing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from vcfbench.cli.main import app

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "howto" / "first-hour.md").read_text(encoding="utf-8")
QUESTIONS = re.findall(r"^\| (\d+)\. .* \| (.*) \|$", PAGE, re.MULTILINE)


def test_ten_questions_have_their_lines() -> None:
    assert [int(number) for number, _ in QUESTIONS] == [*range(1, 11)]


@pytest.mark.parametrize(("number", "typed"), QUESTIONS)
def test_each_question_has_lines_that_talk_takes(
    number: str, typed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = [line for line in re.findall(r"`([^`]+)`", typed) if not line.startswith("vcfbench")]
    if number == "8":  # of one that never triggers the rest is for a person's Ctrl-C
        lines = [line for line in lines if ":DIG" not in line]
    words = ["talk", "--raw", *(word for line in lines for word in ("-c", line))]
    done = CliRunner().invoke(app, words)
    assert lines
    assert done.exit_code == 0, done.stderr


@pytest.mark.parametrize("page", ["README.md", "docs/tutorials/first-station.md"])
def test_who_begins_is_told_that_nothing_was_tried_on_hardware(page: str) -> None:
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    assert "othing was tried on hardware" in text
    assert "howto/first-hour.md" in text
