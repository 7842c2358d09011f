"""The references of API and command line are what docstrings and commands say now."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import vcfbench

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "api.md"


@pytest.mark.exhaustive
@pytest.mark.parametrize("script", ["docs/make_api.py", "docs/make_cli.py"])
def test_the_page_is_up_to_date(script: str) -> None:
    """Run the script if it is not."""
    command = [sys.executable, str(ROOT / script), "--check"]
    assert subprocess.run(command, check=False).returncode == 0, f"python {script}"  # noqa: S603


def test_every_public_name_has_its_entry() -> None:
    headings = re.findall(r"^### (?:class )?(\w+)$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(headings) == sorted(vcfbench.__all__)


def test_signatures_fields_and_words_are_there() -> None:
    page = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert "run( procedure: str |" in page
    assert "- `samples: bounds.Samples = 10`: readings a mean" in page
    assert "- `k_vc: Quantity`: Rate that one volt of V_Vc stands for." in page
    assert "`Run.readings: tuple[RawReading, ...]` Every raw reading, in the order of time" in page
    assert "- [`LimitError`](#class-limiterror): a step would leave a limit of the bench" in page
    assert "The arguments are those of [`run`](#run)." in page
