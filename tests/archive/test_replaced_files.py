"""A file that a command cannot write to its end leaves the one of that name as it was, and nothing beside it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from simrack_tests.cells import few

import vcfbench
from vcfbench.archive.batch_sheet import sheet_rows, write_sheet
from vcfbench.archive.compared import compare_runs
from vcfbench.archive.export import FORMATS
from vcfbench.archive.written import write_document, write_figures
from vcfbench.errors import ConfigError
from vcfbench.files import replaced

WORDS = {
    "laboratory": "L",
    "laboratory_address": "A",
    "country": "GR",
    "customer": "C",
    "customer_address": "R",
    "responsible": "P",
    "serial": "G-7",
}
NAMES = (
    *("r.html", "r.md", "r.pdf", "r.xml", "c.html", "f.svg", "f.png", "f.pdf", "s.html", "s.xlsx"),
    *(f"e.{each}" for each in FORMATS if each != "xlsx"),  # whose library writes to another disk first
)
NEEDS = {
    "r.pdf": ("weasyprint",),
    "s.xlsx": ("openpyxl",),
    "e.parquet": ("pandas", "pyarrow"),
    "e.hdf5": ("h5py",),
}
LIMITED = """
import resource, sys
from pathlib import Path
from tests.archive.test_replaced_files import write
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
write(Path(sys.argv[1]), Path(sys.argv[2]))
"""


def write(runs: Path, file: Path) -> None:
    """Write the file of this name about the run there."""
    run = vcfbench.load_run("last", runs)
    if file.name[0] == "r":
        made = vcfbench.write_certificate if file.suffix == ".xml" else vcfbench.write_report
        made(run, file, WORDS)
    elif file.name[0] == "c":
        write_document(compare_runs(run, run).report(), "c", "c", file)
    elif file.name[0] == "f":
        write_figures(run, file, 1)
    elif file.name[0] == "s":
        write_sheet("b", sheet_rows("b", runs), file)
    else:
        vcfbench.export_run(run, file, raw=True)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("records")
    vcfbench.run("turntable", seed=1, metadata={"dut": "G-7", "tags": {"batch": "b"}}, runs=folder)
    return folder


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of the size of files")
@pytest.mark.parametrize("name", few(NAMES, "r.md", "e.csv"))
def test_full_disk_leaves_file_as_it_was(name: str, runs: Path, tmp_path: Path) -> None:
    for library in NEEDS.get(name, ()):
        pytest.importorskip(library)
    file = tmp_path / name
    write(runs, file)
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir()}
    command = [sys.executable, "-B", "-c", LIMITED, str(runs), str(file)]
    root = Path(__file__).parents[2]
    found = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root / "simrack"), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=root, env=found)  # noqa: S603
    assert "ConfigError" in done.stderr.strip().splitlines()[-1]
    assert "written" in done.stderr
    assert "ignored" not in done.stderr
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == before


def test_protected_file_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "issued.html"
    file.write_text("issued")
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != file)
    with (
        pytest.raises(ConfigError, match=r"issued.html: cannot be written: Permission denied"),
        replaced(file) as draft,
    ):
        draft.write_text("anew")
    assert [each.name for each in tmp_path.iterdir()] == ["issued.html"]
    assert file.read_text() == "issued"


@pytest.mark.exhaustive
def test_figures_of_protected_report_stay(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "r.md"
    write(runs, file)
    drawn = tmp_path / "r-1.svg"
    drawn.write_text("issued")
    monkeypatch.setattr(os, "access", lambda path, _: Path(path) != file)
    with pytest.raises(ConfigError, match=r"r\.md: cannot be written: Permission denied"):
        write(runs, file)
    assert drawn.read_text() == "issued"


def test_link_still_leads_to_file(tmp_path: Path) -> None:
    file, link = tmp_path / "r.html", tmp_path / "link.html"
    link.symlink_to(file)
    with replaced(link) as draft:
        draft.write_text("anew")
    assert link.is_symlink()
    assert file.read_text() == "anew"


@pytest.mark.skipif(sys.platform == "win32", reason="no modes of files")
def test_replaced_file_keeps_its_mode(tmp_path: Path) -> None:
    file = tmp_path / "r.html"
    file.touch(0o640)
    with replaced(file) as draft:
        draft.write_text("anew")
    assert file.stat().st_mode & 0o777 == 0o640
