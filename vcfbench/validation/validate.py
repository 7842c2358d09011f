"""Validation of the program on the machine and bench of a laboratory, as values and as a document."""

from __future__ import annotations

import getpass
import platform
from collections.abc import Callable, Mapping  # the arguments are held against the annotations
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from vcfbench.archive.written import write_document
from vcfbench.bench.check import check_bench
from vcfbench.clock import utc_now
from vcfbench.procedures.bench_file import load_bench
from vcfbench.reports.document import Heading, Notice, Report, Table, Text, facts, texts
from vcfbench.safety.trust import Trust
from vcfbench.station.description import BenchDescription
from vcfbench.validation import benches, installation, numbers
from vcfbench.validation.check import Check, Checked, Found, Verdict, made

if TYPE_CHECKING:
    from datetime import datetime

_LIMITS = (
    "This document says that the program, as installed on this machine, answered the questions below as stated on the "
    "day below. It helps a laboratory to validate its software (ISO/IEC 17025:2017, 7.11.2). It is no accreditation "
    "and no calibration, and says nothing of instruments beyond what stands under Own bench."
)
_KINDS: Mapping[Verdict, str] = {"PASS": "pass", "FAIL": "fail", "NOT CHECKED": "warning"}


class Validation(Struct, frozen=True):
    """Outcome of a validation: its checks, versions, machine, time, and person.

    >>> outcome = vcfbench.validate(by="A. Person")
    >>> outcome.passed, outcome.failed
    (True, ())
    """

    checks: tuple[Checked, ...]
    versions: Mapping[str, str]
    machine: str
    by: str
    began: datetime
    took_s: float

    @property
    def passed(self) -> bool:
        """True if no check has failed."""
        return all(each.verdict != "FAIL" for each in self.checks)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the checks that have failed."""
        return tuple(each.name for each in self.checks if each.verdict == "FAIL")


def validate(
    bench: BenchDescription | Path | str | None = None,
    *,
    by: str = "",
    runs: int = benches.RUNS,
    trust: Trust = False,
    shown: Callable[[Checked], None] = lambda _: None,
) -> Validation:
    """Run all checks with known answers on this machine, and return the answers.

    Args:
        bench: bench file of the laboratory's own bench, which is checked as by ``vcfbench bench check``; None for none.
        by: who validates; empty for the user of the machine.
        runs: number of calibrations of simulated gyroscopes that are held against the truth, at least 30.
        trust: as of :func:`vcfbench.run`.
        shown: is called with each check when it is done.

    Raises:
        ConfigError: the bench file cannot be used.
        ValueError: `runs` is below 30, of which no share can be told.

    >>> vcfbench.validate(by="A. Person").passed
    True
    """
    if runs < 30:
        raise ValueError(f"runs: expected at least 30, got {runs}")
    description = load_bench(bench) if isinstance(bench, str | Path) else bench
    began = utc_now()
    areas = {
        "Installation": installation.CHECKS,
        "Arithmetic": numbers.CHECKS,
        "Simulated bench": benches.checks(runs),
        "Own bench": () if description is None else _own(description, trust),
    }
    checks = []
    for area, questions in areas.items():
        for each in questions:
            checks.append(made(area, each))
            shown(checks[-1])
    machine = f"{platform.node()}, {platform.platform()}, {platform.machine()}"
    took_s = (utc_now() - began).total_seconds()
    return Validation(tuple(checks), installation.versions(), machine, by or getpass.getuser(), began, took_s)


def _own(description: BenchDescription, trust: Trust) -> tuple[Check, ...]:
    def answer() -> Found:
        found = check_bench(description, trust=trust)
        came = [
            f"{each.role}: {each.problem or 'well'}" + (", calibration overdue" if each.equipment.overdue else "")
            for each in found.instruments
        ]
        overdue = any(each.equipment.overdue for each in found.instruments)
        return Found("each instrument well, none overdue", "; ".join(came), found.failure() is None and not overdue)

    return (Check(description.name, "Do its instruments answer as they should?", "vcfbench bench check", answer),)


def validation_report(found: Validation) -> Report:
    """Return the document of a validation."""
    counts = {verdict: sum(each.verdict == verdict for each in found.checks) for verdict in _KINDS}
    summary = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
    rows = [
        ("validated by", found.by),
        ("on", f"{found.began:%Y-%m-%d %H:%M:%S} UTC, in {found.took_s:.0f} s"),
        ("machine", found.machine),
        ("result", f"{'PASS' if found.passed else 'FAIL'}: {summary}"),
        ("signature", ""),
    ]
    areas: list[Heading | Table | Text] = []
    for area in dict.fromkeys(each.area for each in found.checks):
        made_here = [each for each in found.checks if each.area == area]
        answers = [(each.verdict, each.name, each.expected, each.came) for each in made_here]
        questions = "\n".join(f"{each.name}: {each.question} ({each.source})" for each in made_here)
        areas += [Heading(area, 2), Table(texts("verdict", "check", "right answer", "answer"), answers)]
        areas.append(Text(questions))
    return Report(
        [
            Heading("Validation of vcfbench"),
            Notice(
                f"All checks that could be made have passed: {summary}."
                if found.passed
                else f"FAILED: {', '.join(found.failed)}.",
                "pass" if found.passed else "fail",
            ),
            facts(rows),
            Text(_LIMITS),
            *areas,
            Heading("Versions", 2),
            facts(list(found.versions.items())),
        ]
    )


def write_validation(found: Validation, path: Path) -> tuple[Path, ...]:
    """Write the document as ``.html``, ``.pdf`` or ``.md``; raises ConfigError where that cannot be."""
    return write_document(validation_report(found), "Validation of vcfbench", f"{found.began:%Y-%m-%d}", path)
