"""The public face: what ``import vcfbench`` offers, and that it costs nothing and leaks nothing."""

from __future__ import annotations

import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import vcfbench
from vcfbench.faces import homes

ROOT = Path(__file__).parents[1]
NO_DOCSTRING = {"Event", "PROCEDURES", "Plan", "Routine", "__version__"}
"""Values and an alias of a type: what they are is said beside them, and in the table of docs/python.md."""


def test_dir_shows_what_is_public() -> None:
    assert dir(vcfbench) == sorted(set(vcfbench.__all__))
    assert len(vcfbench.__all__) == len(dir(vcfbench))


def test_every_name_is_there_and_explains_itself() -> None:
    for name in vcfbench.__all__:
        value: Any = getattr(vcfbench, name)
        assert not isinstance(value, ModuleType), name
        assert name in NO_DOCSTRING or inspect.getdoc(value), name


def test_nothing_else_is_public() -> None:
    """Modules apart, which importing puts there: also when every name has been used."""
    for name in vcfbench.__all__:
        getattr(vcfbench, name)
    seen = {name for name, value in vars(vcfbench).items() if not isinstance(value, ModuleType)}
    assert {name for name in seen if not name.startswith("_")} <= {*vcfbench.__all__}


def test_no_module_hides_a_name() -> None:
    modules = {path.stem for path in (ROOT / "vcfbench").iterdir()}
    assert modules & set(vcfbench.__all__) == set()


def test_an_unknown_name_is_an_attribute_error() -> None:
    name = "measure"
    with pytest.raises(AttributeError, match="module 'vcfbench' has no attribute 'measure'"):
        getattr(vcfbench, name)


def test_the_stub_lists_modules_that_define_the_name() -> None:
    for name, module in homes(vcfbench.__file__).items():
        assert hasattr(import_module(module), name), f"{module}.{name}"


def test_importing_it_imports_nothing_else() -> None:
    """So it takes some milliseconds; how many exactly depends on what else the machine does."""
    code = "import sys; before = set(sys.modules); import vcfbench; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.split() == ["vcfbench"]
