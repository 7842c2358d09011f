"""``vcfbench report``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import vcfbench
from tests import warm
from tests.archive.test_written import QUICK

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with one run in it."""
    folder = tmp_path_factory.mktemp("reports")
    vcfbench.run("turntable", seed=3, settings=QUICK, runs=folder / "runs")
    return folder


def test_report_without_arguments_writes_last_run(folder: Path) -> None:
    done = warm.run(["vcfbench", "report"], folder)
    (run,) = (folder / "runs").iterdir()
    assert (done.returncode, done.stdout) == (0, f"{run.name}.html\n"), done.stderr
    assert (folder / f"{run.name}.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_files_are_named_as_they_are_written(folder: Path) -> None:
    done = warm.run(["vcfbench", "report", "last", "-o", "mine.md"], folder)
    assert done.stdout.split() == ["mine.md", "mine-1.svg", "mine-2.svg"]


def test_what_is_not_there_is_said(folder: Path) -> None:
    done = warm.run(["vcfbench", "report", "none"], folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "there is no run 'none'" in done.stderr


@pytest.mark.exhaustive
def test_figures_are_drawn_alone_or_all(folder: Path) -> None:
    drawn = warm.run(["vcfbench", "plot", "-o", "fig.png"], folder)
    assert drawn.stdout.split() == ["fig-1.png", "fig-2.png"], drawn.stderr
    drawn = warm.run(["vcfbench", "plot", "last", "--figure", "1", "-o", "residuals.svg"], folder)
    assert drawn.stdout.split() == ["residuals.svg"]
    assert "residual of the span / ppm" in (folder / "residuals.svg").read_text(encoding="utf-8")
    refused = warm.run(["vcfbench", "plot", "--figure", "3"], folder)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "expected a figure from 1 to 2, got 3" in refused.stderr


def test_all_runs_of_a_tag_are_reported_by_one_template(folder: Path) -> None:
    vcfbench.run("turntable", seed=4, settings=QUICK, runs=folder / "runs", metadata={"tags": {"batch": "7"}})
    (folder / "out").mkdir()
    (folder / "lab.toml").write_text('title = "Our certificate"\nlaboratory = "L & Co"\nlogo = "l.svg"\n', "utf-8")
    (folder / "l.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>', "utf-8")
    words = ["--template", "lab.toml", "--set", "customer=ACME", "--set", "issued=2126-11-23"]
    done = warm.run(["vcfbench", "report", "--tag", "batch=7", *words, "-o", "out"], folder)
    (page,) = (folder / "out").iterdir()
    assert (done.returncode, done.stdout) == (0, f"out/{page.name}\n"), done.stderr
    text = page.read_text("utf-8")
    for said in ("<h1>Our certificate</h1>", "L &amp; Co", "ACME", "2126-11-23", 'src="data:image/svg+xml;base64,'):
        assert said in text


@pytest.mark.exhaustive
def test_stopped_run_does_not_prevent_other_reports(folder: Path) -> None:
    """Of a lot, the certificates of those behind it are written; which has none is said, and the exit code too."""
    for seed in (4, 5, 6):
        told = {"dut": f"G-{seed}", "operator": "A. Person", "tags": {"lot": "9"}}
        run = vcfbench.run("turntable", "ideal", seed=seed, settings=QUICK, runs=folder / "runs", metadata=told)
        if seed == 5:
            journal = run.directory / "journal.jsonl"
            journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:-3]))
            stopped = run.name
    words = ["laboratory=L", "laboratory_address=A", "country=GR", "customer=ACME", "customer_address=B"]
    sets = [part for each in words for part in ("--set", each)]
    (folder / "lot").mkdir()
    done = warm.run(["vcfbench", "report", "--tag", "lot=9", "--dcc", *sets, "-o", "lot"], folder)
    assert done.returncode == 2
    assert len(list((folder / "lot").iterdir())) == len(done.stdout.split()) == 2
    assert "a certificate needs a run that is complete" in done.stderr
    assert f"1 of 3 runs have no report: {stopped}" in " ".join(done.stderr.split())


@pytest.mark.exhaustive
def test_words_that_no_certificate_has_are_refused(folder: Path) -> None:
    for words, said in (
        (["--set", "custommer=x"], "got 'custommer'"),
        (["--set", "issued=tomorrow"], "issued: expected a day such as 2026-11-23, got 'tomorrow'"),
        (["--set", "logo=a.exe"], "expected a name that ends in .png, .jpg, .svg"),
        (["--all", "-o", "nowhere"], "expected a directory in -o"),
        (["--all", "--tag", "batch=none"], "has no run of that name"),
    ):
        refused = warm.run(["vcfbench", "report", *words], folder)
        assert (refused.returncode, said in " ".join(refused.stderr.split())) == (2, True), refused.stderr
