"""What a calibration loads: SciPy costs more to load than a simulated run takes, and every module of ours its share."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from msgspec import Struct
from simrack_tests.cells import few

from vcfbench.instructions import schedule
from vcfbench.procedures.virtual_coriolis import settings as own_settings
from vcfbench.station import description, parts, settings

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

RUN = """
import sys
import vcfbench
settings = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
run = vcfbench.run(sys.argv[1], settings=settings, runs=sys.argv[2])
run.report()
print(len(run.results.uncertainty.values), sorted({"scipy", "GTC", "numpy.f2py"} & set(sys.modules)))
"""
COMMAND = """
import sys
from contextlib import redirect_stdout, suppress
from io import StringIO
from vcfbench.cli.main import main
sys.argv = ["vcfbench", "run", "virtual-coriolis", "--json", "--quiet", "--seed", "1", "--runs", sys.argv[1]]
with redirect_stdout(StringIO()), suppress(SystemExit):
    main()
own = {name: module for name, module in sys.modules.items() if name.startswith("vcfbench")}
classes = {each for module in own.values() for each in vars(module).values() if isinstance(each, type)}
print(*sorted(each.__name__ for each in classes if hasattr(each, "__dataclass_fields__")))
"""


@pytest.mark.parametrize(("procedure", "values"), few([("turntable", 4), ("virtual-coriolis", 9)], ("turntable", 4)))
def test_a_run_with_its_budget_loads_no_scipy(procedure: str, values: int, tmp_path: Path) -> None:
    command = [sys.executable, "-c", RUN, procedure, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.splitlines()[-1] == f"{values} []"


def test_plans_load_no_numpy() -> None:
    """It takes 0.1 s, and commands that read plans or records do not need it."""
    command = [sys.executable, "-c", "import sys, vcfbench.steps; print('numpy' in sys.modules)"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout == "False\n"


@pytest.mark.exhaustive
def test_a_run_makes_no_dataclass(tmp_path: Path) -> None:
    """A frozen dataclass takes 0.7 ms to make, a struct 0.02 ms."""
    done = subprocess.run([sys.executable, "-c", COMMAND, str(tmp_path)], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.split() == []


@pytest.mark.parametrize("module", [description, parts, settings, schedule, own_settings])
def test_the_types_of_what_every_run_reads_are_no_texts(module: ModuleType) -> None:
    """Reading them as texts took 6 ms of each run: these modules have no ``from __future__ import annotations``."""
    classes = [each for each in vars(module).values() if isinstance(each, type) and each.__module__ == module.__name__]
    types = {each.__name__: each.__annotations__.values() for each in classes if issubclass(each, Struct)}
    assert types
    assert [name for name, given in types.items() if any(isinstance(each, str) for each in given)] == []
