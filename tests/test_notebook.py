"""The notebook among the examples runs from its first cell to its last."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[1] / "examples" / "notebook" / "calibration.ipynb"
KERNEL = """
import sys
import nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], as_version=4)
nbformat.validate(notebook)
NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
nbformat.write(notebook, "done.ipynb")
"""


def cells() -> list[dict[str, Any]]:
    return [cell for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


def python(*words: str, folder: Path) -> str:
    done = subprocess.run(  # noqa: S603
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False, timeout=180
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_is_kept_without_outputs() -> None:
    assert all((cell["outputs"], cell["execution_count"]) == ([], None) for cell in cells())


@pytest.mark.exhaustive
def test_its_code_runs_as_a_script(tmp_path: Path) -> None:
    """Also where there is no notebook."""
    pytest.importorskip("pandas", reason="pip install '.[dev]'")
    script = tmp_path / "calibration.py"
    script.write_text("\n".join("".join(cell["source"]) for cell in cells()), encoding="utf-8")
    printed = python(str(script), folder=tmp_path).splitlines()
    assert any(line.startswith("K_Vc: 150") for line in printed)
    assert "51 points from 560 readings" in printed
    assert printed[-2].startswith("True complete")
    assert (tmp_path / "report.html").stat().st_size > 50_000


@pytest.mark.exhaustive
def test_the_paper_s_notebook_says_that_every_number_holds(tmp_path: Path) -> None:
    source = (NOTEBOOK.parent / "article.ipynb").read_text(encoding="utf-8")
    code = ["".join(cell["source"]) for cell in json.loads(source)["cells"] if cell["cell_type"] == "code"]
    script = tmp_path / "article.py"
    script.write_text("\n".join(code), encoding="utf-8")
    assert "All 57 printed numbers hold, and all 11 errata are shown." in python(str(script), folder=tmp_path)


@pytest.mark.exhaustive
@pytest.mark.skipif(find_spec("nbclient") is None or find_spec("ipykernel") is None, reason="pip install '.[dev]'")
def test_it_runs_as_a_notebook(tmp_path: Path) -> None:
    python("-c", KERNEL, str(NOTEBOOK), folder=tmp_path)
    done = json.loads((tmp_path / "done.ipynb").read_text(encoding="utf-8"))
    outputs = {cell["id"]: cell["outputs"] for cell in done["cells"] if cell["cell_type"] == "code"}
    (shown,) = outputs["run"]
    assert "<table>" in "".join(shown["data"]["text/html"])
    assert any("image/png" in each.get("data", {}) for each in outputs["figures"])
    tables = ["".join(each.get("data", {}).get("text/html", "")) for each in outputs["readings"]]
    assert any('class="dataframe"' in table for table in tables)
