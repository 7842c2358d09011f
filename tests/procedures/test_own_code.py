"""Procedures of others: files of one's own and installed packages, and what is wrong with them."""

from __future__ import annotations

import importlib.metadata
import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING

import pytest
from msgspec import structs

import vcfbench
from vcfbench.errors import BenchError, ConfigError, PlanError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures import catalogue
from vcfbench.procedures.catalogue import PROCEDURES, procedure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Write = Callable[[str], Path]

GOOD = """\
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from vcfbench import Note, Plan, Procedure, ProcedureSettings, Settle


class WaitSettings(ProcedureSettings, frozen=True):
    times: Annotated[int, Meta(ge=1, le=9, description="how often")] = 2


@dataclass(frozen=True, slots=True)
class Waited:
    times: int


def plan(settings: WaitSettings) -> Plan:
    for _ in range(settings.times):
        yield Settle(1.0, "for nothing")


def results(settings: WaitSettings, _points: object) -> Waited:
    return Waited(settings.times)


WAIT = Procedure(name="wait", title="Wait.", settings=WaitSettings, plan=plan, results=results)
"""
MAKE = "\nMORE = Procedure(name={!r}, title='More.', settings=WaitSettings, plan=plan, results=results)\n"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(text: str) -> Path:
        (tmp_path / "wait.py").write_text(text, encoding="utf-8")
        return tmp_path / "wait.py"

    return written


def test_a_file_is_a_procedure(write: Write, tmp_path: Path) -> None:
    path = write(GOOD)
    run = vcfbench.run(path, settings={"times": 3}, runs=tmp_path)
    assert (run.procedure, run.status) == ("wait", "complete")
    assert (run.results.times, run.physical_minimum_s) == (3, 3.0)
    assert run.header["settings"]["times"] == 3
    assert len(vcfbench.dry_run(str(path)).steps) == 2
    with pytest.raises(ConfigError, match=r"settings: procedure\.times: expected a whole number at least 1"):
        vcfbench.dry_run(path, settings={"times": 0})
    again = vcfbench.load_run("last", tmp_path)
    assert again.no_results == "the procedure 'wait' is not known here"
    assert again.results["times"] == 3


def test_a_file_may_use_procedures_that_come_along(write: Write) -> None:
    path = write(GOOD + "\nfrom vcfbench.procedures.turntable import TURNTABLE\n")
    assert procedure(path).name == "wait"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1\nx = = 2\n", "wait.py, line 2: SyntaxError: invalid syntax"),
        ("x = 1\n\ny = z\n", "wait.py, line 3: NameError: name 'z' is not defined"),
        ("import sys\nsys.exit(0)\n", "wait.py, line 2: SystemExit: 0"),
        ("import nowhere\n", "wait.py, line 1: ModuleNotFoundError: No module named 'nowhere'"),
        ("def f():\n    return 1 / 0\nf()\n", "wait.py, line 2: ZeroDivisionError: division by zero"),
        ("x = 1\n", "wait.py: expected a file with one Procedure, got none"),
        (GOOD + MAKE.format("more"), "wait.py: expected a file with one Procedure, got 2: wait, more"),
        (GOOD + MAKE.format("wait"), "wait.py: expected a file with one Procedure, got 2: wait, wait"),
        (GOOD.replace('"wait"', '"turntable"'), "its procedure is called 'turntable', a name taken by vcfbench itself"),
        (GOOD.replace('"wait"', '"w w"'), "expected a procedure's name of letters, digits, '-' and '_', got 'w w'"),
        (GOOD.replace('title="Wait.", ', ""), "procedure 'wait': give a title of one line"),
        (
            GOOD.replace("plan=plan", "plan=7"),
            "ConfigError: procedure 'wait': plan: expected a function, got 7",
        ),
        (GOOD.replace("settings=WaitSettings", "settings=int"), "expected settings that are ProcedureSettings"),
        ("\0", "wait.py cannot be run"),
    ],
)
def test_a_file_that_is_none_is_one_sentence(text: str, said: str, write: Write) -> None:
    path = write(text)
    with pytest.raises(ConfigError) as caught:
        vcfbench.dry_run(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_file_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected a procedure's file, there is no such file"):
        vcfbench.dry_run(tmp_path / "none.py")


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ('        yield Settle(1.0, "for nothing")', "        yield 1 / 0", "wait.py, line 22: ZeroDivisionError"),
        ('Settle(1.0, "for nothing")', 'Settle("1", "for nothing")', "wait.py, line 22: ConfigError: "),
        ("        yield Settle(1", "        yield from Settle(1", "wait.py, line 22: TypeError: "),
        (
            '        yield Settle(1.0, "for nothing")',
            "        yield from __import__('vcfbench').powered(settings, None)",
            "wait.py, line 22: ConfigError: work: expected Generator, got nothing",
        ),
        (
            '        yield Settle(1.0, "for nothing")',
            "        yield __import__('vcfbench').go_to_rate(settings, 1.0, previous_deg_s=0.0)",
            "step 1: expected a step, the plan yields the steps of go_to_rate; write yield from",
        ),
        ('        yield Settle(1.0, "for nothing")', "        yield 7", "step 1: expected a step, the plan yields 7"),
        ('        yield Settle(1.0, "for nothing")', "        pass", "expected a plan that yields steps, got None"),
        ("def plan(settings: WaitSettings)", "def plan(settings, bench)", "expected a plan that takes the settings: "),
        (
            "    times: A",
            "    def contradictions(self):\n        return self.x\n\n    times: A",
            "wait.py, line 13: AttributeError",
        ),
    ],
)
def test_mistake_in_a_plan_has_file_and_line(good: str, bad: str, said: str, write: Write, tmp_path: Path) -> None:
    assert good in GOOD
    with pytest.raises(PlanError) as caught:
        vcfbench.run(write(GOOD.replace(good, bad)), runs=tmp_path / "runs")
    assert said in str(caught.value)
    assert not (tmp_path / "runs").exists() or list((tmp_path / "runs").iterdir()) == []


def test_mistake_on_the_bench_leaves_record_and_safe_bench(write: Write, tmp_path: Path) -> None:
    """The second time that the plan is asked for, it is in earnest."""
    asked = "def plan(settings: WaitSettings, asked=[]) -> Plan:\n    asked.append(1)"
    wrong = '        if len(asked) == 2:\n            yield {}["x"]\n'
    text = GOOD.replace("def plan(settings: WaitSettings) -> Plan:", asked)
    text = text.replace("\n\ndef results", f"{wrong.replace('        if', '    if', 1)}\n\ndef results")
    with pytest.raises(PlanError, match=r"'wait' has a mistake: .*wait.py, line 25: KeyError: 'x'") as caught:
        vcfbench.run(write(text), runs=tmp_path)
    assert caught.value.exit_code == 2
    again = vcfbench.load_run("last", tmp_path)
    assert (again.status, len(list(again.header["identities"]))) == ("aborted", 5)


# --- installed packages ---


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Install packages that bring entry points, for this test."""
    entries: list[EntryPoint] = []

    def entry_points(*, group: str, name: str | None = None) -> list[EntryPoint]:
        return [each for each in entries if each.group == group and name in {None, each.name}]

    def installed(name: str, value: str) -> None:
        entries.append(EntryPoint(name, value, "vcfbench.procedures"))
        catalogue._installed.cache_clear()

    monkeypatch.setattr(importlib.metadata, "entry_points", entry_points)
    yield installed
    catalogue._installed.cache_clear()


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    monkeypatch.syspath_prepend(str(tmp_path))

    def written(text: str) -> None:
        (tmp_path / "acme_of_a_test.py").write_text(text, encoding="utf-8")

    yield written
    sys.modules.pop("acme_of_a_test", None)


def test_an_installed_procedure_is_found_by_its_name(
    install: Callable[..., None], package: Callable[[str], None]
) -> None:
    package(GOOD)
    install("wait", "acme_of_a_test:WAIT")
    assert list(PROCEDURES) == [*BUILT_IN, "wait"]
    assert "acme_of_a_test" not in sys.modules
    assert "acme_of_a_test:WAIT" in PROCEDURES.title("wait")
    assert len(vcfbench.dry_run("wait", settings={"times": 4}).steps) == 4
    assert vcfbench.PROCEDURES["wait"].title == "Wait."


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = = 1", r"acme_of_a_test\.py, line 1: SyntaxError"),
        ("\nraise OSError('no licence')", r"acme_of_a_test\.py, line 2: OSError: no licence"),
        ("import sys\nsys.exit()", r"acme_of_a_test\.py, line 2: SystemExit"),
        ("WAIT = 3", "expected a Procedure of that name, got 3"),
        ("x = 1", "AttributeError: module 'acme_of_a_test' has no attribute 'WAIT'"),
        (GOOD.replace('"wait"', '"other"'), "expected a Procedure of that name, got <Procedure other>"),
    ],
)
def test_a_broken_package_is_one_sentence_and_breaks_no_other(
    text: str, said: str, install: Callable[..., None], package: Callable[[str], None]
) -> None:
    package(text)
    install("wait", "acme_of_a_test:WAIT")
    with pytest.raises(ConfigError, match=said) as caught:
        vcfbench.dry_run("wait")
    assert "the procedure 'wait' of a package (acme_of_a_test:WAIT)" in str(caught.value)
    assert vcfbench.dry_run("turntable").steps
    assert [each.name for each in PROCEDURES.loaded()] == [*BUILT_IN]


def test_duplicate_name_is_refused_with_both_origins(install: Callable[..., None]) -> None:
    install("wait", "acme_of_a_test:WAIT")
    install("wait", "other:WAIT")
    said = r"'wait' is taken twice: a package \(acme_of_a_test:WAIT\) and a package \(other:WAIT\)"
    with pytest.raises(ConfigError, match=said):
        vcfbench.dry_run("wait")
    assert vcfbench.dry_run("virtual-coriolis").steps


def test_built_in_procedure_keeps_its_name(
    install: Callable[..., None],
) -> None:
    install("turntable", "acme_of_a_test:WAIT")
    assert vcfbench.dry_run("turntable").procedure == "turntable"
    assert "That of a package (acme_of_a_test:WAIT) has to be renamed" in PROCEDURES.title("turntable")
    assert "renamed" not in PROCEDURES.title("virtual-coriolis")


@pytest.mark.parametrize("name", BUILT_IN)
def test_an_object_of_a_built_in_name_is_refused(name: str, write: Write) -> None:
    own = procedure(write(GOOD))
    taken = f"a Procedure is called '{name}', a name taken by vcfbench itself; rename it"
    with pytest.raises(ConfigError, match=f"^{re.escape(taken)}$"):
        procedure(structs.replace(own, name=name))
    known = procedure(name)
    assert procedure(known) is known
    with pytest.raises(ConfigError, match="rename it"):
        procedure(structs.replace(known, title="Another."))


def test_built_in_procedure_is_found_without_scanning_packages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where many are installed that takes as long as reading the command line."""
    monkeypatch.setattr(catalogue, "_installed", lambda: pytest.fail("looked through the packages"))
    assert PROCEDURES["turntable"].name == "turntable"


def test_an_unknown_name_is_answered_with_those_that_there_are() -> None:
    with pytest.raises(BenchError, match=f"there is no procedure 'spin'; known are {', '.join(BUILT_IN)}"):
        vcfbench.run("spin")


def test_names_are_known_without_importing_a_procedure() -> None:
    code = (
        "import sys; from vcfbench import PROCEDURES; list(PROCEDURES); "
        "print([name for name in sys.modules if name in ('msgspec', 'numpy', 'vcfbench.procedures.turntable')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout == "[]\n"
