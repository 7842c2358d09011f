"""What is asked for without its extra says which to install."""

from __future__ import annotations

import json
import re
import sys
from typing import TYPE_CHECKING

import pytest

from vcfbench.errors import ConfigError
from vcfbench.extras import need

if TYPE_CHECKING:
    from pathlib import Path


def test_what_is_installed_is_imported() -> None:
    assert need("json", "export", "an export") is json


def test_a_module_within_a_package_is_that_module() -> None:
    assert need("json.decoder", "export", "an export").JSONDecodeError is json.JSONDecodeError


def test_missing_library_error_names_its_extra() -> None:
    with pytest.raises(ConfigError, match="a page needs no_such_library, which is not installed") as refused:
        need("no_such_library.inside", "page", "a page")
    assert re.fullmatch(r'pip install "starlette>=[\d.]+" "uvicorn>=[\d.]+"', str(refused.value.hint))
    assert refused.value.exit_code == 2


@pytest.mark.parametrize(("extra", "hint"), [("page", '"a>=1.2" "b"'), ("other", '"c<3"'), ("none", "no_such_library")])
def test_the_libraries_of_the_extra_are_named_and_no_others(
    extra: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ["core>=1", "os>=1; python_version > '3'", "a>=1.2; extra == 'page'", "c<3; extra == 'other'"]
    asked += ["b; extra == 'page' and python_version > '3'", "d; extra == 'page' and python_version < '3'"]
    (tmp_path / "vcfbench-1.0.dist-info").mkdir()
    (tmp_path / "vcfbench-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.3\nName: vcfbench\nVersion: 1.0\n" + "".join(f"Requires-Dist: {each}\n" for each in asked)
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError) as refused:
        need("no_such_library", extra, "a page")
    assert refused.value.hint == f"pip install {hint}"


def test_what_is_installed_but_broken_is_not_called_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "half_a_library.py").write_text("import what_it_needs_itself\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match="cannot be imported: No module named 'what_it_needs_itself'"):
        need("half_a_library", "export", "an export")
    assert "half_a_library" not in sys.modules
