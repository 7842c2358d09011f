"""The pages of API, command line and formats are made of the program when the site is built."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest
from typer.main import get_command

import vcfbench
from vcfbench.cli.main import app
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.steps.step import Step, StepResult
from vcfbench_tables import language

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def page() -> str:
    text: str = runpy.run_path(str(DOCS / "make_api.py"))["api_page"]()
    return text


def test_api_page_has_every_public_name(page: str) -> None:
    headings = re.findall(r"^### (?:class )?(\w+)$", page, flags=re.MULTILINE)
    assert sorted([*headings, "__version__"]) == sorted(vcfbench.__all__)


def test_api_page_has_signatures_fields_and_words(page: str) -> None:
    words = " ".join(page.split())
    assert "run( procedure: str |" in words
    assert "- `samples: bounds.Samples = 10`: readings per mean" in words
    assert "- `k_vc: FittedValue`: Rate that one volt of V_Vc stands for." in words
    assert "`Run.readings: tuple[RawReading, ...]` Every raw reading, in the order of time" in words
    assert "- [`LimitError`](#class-limiterror): a step would leave a limit of the bench" in words
    assert "The arguments are those of [`run`](#run)." in words


def test_page_of_the_command_line_has_every_command() -> None:
    shown: str = runpy.run_path(str(DOCS / "make_cli.py"))["cli_page"]()
    names = [name for name, each in get_command(app).commands.items() if not each.hidden]
    assert all(f"\n## vcfbench {name}\n" in shown for name in names)


def test_page_of_formats_has_steps_fields_and_bounds() -> None:
    made = runpy.run_path(str(DOCS / "make_formats.py"))
    page: str = made["formats_page"]()
    kinds = [
        name for name, kind in {**Step.kinds, **StepResult.kinds}.items() if kind.__module__.startswith("vcfbench.")
    ]
    assert all(f"| `{name}` | " in page for name in kinds)
    assert all(set(made["said_of"](kind)) == set(kind.__struct_fields__) for kind in made["ENTRIES"])
    assert "| `uncertainty.table_rate_error` | 0 | 0.1 |" in page
    assert "| `turntable` | `multimeter`, `rate_table` |  | `power`, `oscilloscope`, `rate_source` |" in page
    assert all(f"\n| `{name}` | " in page for name in PROCEDURES)


def test_page_of_formats_has_every_key_of_a_table_profile() -> None:
    made = runpy.run_path(str(DOCS / "make_formats.py"))
    page: str = made["formats_page"]()
    kinds = {kind for kind in vars(language).values() if isinstance(kind, type) and issubclass(kind, language._Part)}
    assert kinds - {language._Part} <= set(made["PROFILE"].values())
    for kind in made["PROFILE"].values():
        assert all(f"| `{name}` | " in page for name in kind.__struct_encode_fields__)
    assert '| `on_silence` | `"fail"` | raise at once, or send `stop` before that; `fail`, `stop` |' in page
