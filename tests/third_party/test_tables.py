"""Rate tables served to programs that nobody here wrote: the maker's own library, PyMeasure's and InstrumentKit's ESP.

The first two over TCP and over a pseudo-terminal.
"""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from tests.third_party.conftest import install
from tests.third_party.test_driver_methods import check, methods
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

WIRES = ["tcp", pytest.param("pty", marks=pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals"))]


@pytest.fixture(scope="session")
def zaber(shared: Path) -> Path:
    """Interpreter of an environment with the library of the maker."""
    return install(shared, "zaber-motion==10.2.0")


@contextmanager
def served_table(dialect: str, folder: Path) -> Iterator[dict[str, str]]:
    said = "\nsteps_per_deg = 1777.7777777777778" if dialect == "zaber" else ""
    file = folder / "bench.toml"
    file.write_text(embedded_text("ideal").replace('dialect = "acl"', f'dialect = "{dialect}"{said}'), encoding="utf-8")
    words = [sys.executable, "-m", "vcfbench", "sim", "serve", "--speed", "max", "--json", "--bench", str(file)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        assert server.stdout is not None
        try:
            yield json.loads(server.stdout.readline())["instruments"]["rate_table"]
        finally:
            server.terminate()
            server.wait(10)


@pytest.mark.parametrize("wire", WIRES)
def test_zaber_motion(wire: str, zaber: Path, tmp_path: Path) -> None:
    with served_table("zaber", tmp_path) as wires:
        check(methods(zaber, "zaber_motion_methods.py", "zaber", wires[wire]), "zaber-motion", 37)


@pytest.mark.parametrize("wire", WIRES)
def test_pymeasure_esp300(wire: str, pymeasure: Path, tmp_path: Path) -> None:
    with served_table("esp", tmp_path) as wires:
        host, _, port = wires["tcp"].removeprefix("socket://").rpartition(":")
        resource = f"TCPIP0::{host}::{port}::SOCKET" if wire == "tcp" else f"ASRL{wires['pty']}::INSTR"
        check(methods(pymeasure, "pymeasure_esp300.py", "esp", resource), "pymeasure.ESP300", 35)


def test_instrumentkit_esp301(libraries: Path, tmp_path: Path) -> None:
    with served_table("esp", tmp_path) as wires:
        check(methods(libraries, "kit_esp301.py", wires["tcp"]), "kit.ESP301", 85)
