"""Programs that nobody here wrote, against the served bench; collected when VCFBENCH_THIRD_PARTY=1 is set.

They are fetched from the package registry into environments that live as long as the session.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

collect_ignore_glob = [] if os.environ.get("VCFBENCH_THIRD_PARTY") == "1" else ["test_*.py"]

HERE = Path(__file__).parent
ROLES = ("power", "rate_source", "multimeter", "oscilloscope")
OFFERED = {"rate_source": "tcp,pty,vxi11,hislip", "oscilloscope": "tcp,pty,vxi11,hislip"}
PYMEASURE = "pymeasure==0.16.0"
QCODES = "qcodes==0.58.0"
TOOLS = ("pyvisa==1.16.2", "pyvisa-py==0.8.1", "pyserial")
LIBRARIES = (
    "python-ivi==0.14.9",
    "instrumentkit==0.6.0",
    "oscope-scpi==0.1.13",
    "keyoscacquire==4.0.0",
    "pylablib==1.4.5",
)
NEEDED = (
    "future", "matplotlib", "pandas", "psutil", "python-usbtmc", "python-vxi11", "pyusb", "quantities", "quantiphy",
    "ruamel.yaml", "tqdm",
)  # fmt: skip
"""What the parts of them that are run here import and we have not; some pin versions that no longer build, or a GUI."""


def command(*words: str | Path, timeout_s: float = 600.0) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYVISA_LIBRARY": "@py"}
    return subprocess.run(  # noqa: S603
        [str(word) for word in words], capture_output=True, text=True, check=False, timeout=timeout_s, env=environment
    )


def environment(folder: Path) -> Path:
    """Make an environment; return its interpreter."""
    venv.create(folder)
    return folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"


def pip(python: Path, *words: str | Path) -> None:
    """Let our own pip do something for an environment: to give each its own costs seconds."""
    done = command(sys.executable, "-m", "pip", "--python", python, "--quiet", "--disable-pip-version-check", *words)
    assert done.returncode == 0, done.stderr[-2000:]


def install(python: Path, *words: str) -> Path:
    """Add packages to an environment; return its interpreter.

    What is imported is compiled then: that is the least part of them.
    """
    pip(python, "install", "--no-compile", *words)
    return python


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Interpreter of the environment of all whose pins permit it; each is added when it is first needed."""
    return environment(tmp_path_factory.mktemp("shared"))


@pytest.fixture(scope="session")
def pymeasure(shared: Path) -> Path:
    """Interpreter of an environment with PyMeasure."""
    return install(shared, PYMEASURE, *TOOLS, "pytest")


@pytest.fixture(scope="session")
def qcodes(shared: Path) -> Path:
    """Interpreter of an environment with QCoDeS."""
    return install(shared, QCODES, *TOOLS)


@pytest.fixture(scope="session")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Interpreter of an environment with python-ivi, InstrumentKit, oscope-scpi, keyoscacquire and pylablib.

    They are installed without what they say they need; the environment stands on our own.
    """
    python = environment(tmp_path_factory.mktemp("libraries"))
    ours = sysconfig.get_path("purelib")
    place = command(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip()
    (Path(place) / "ours.pth").write_text(f"import site; site.addsitedir({ours!r})\n", encoding="utf-8")
    return install(install(python, *NEEDED), "--no-deps", *LIBRARIES)


@pytest.fixture(scope="session")
def pymeasure_source(pymeasure: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """PyMeasure's source distribution, unpacked; its suites for devices are in there only."""
    folder = tmp_path_factory.mktemp("source")
    pip(pymeasure, "download", "--no-deps", "--no-binary", "pymeasure", "--dest", folder, PYMEASURE)
    with tarfile.open(next(folder.glob("*.tar.gz"))) as archive:
        if hasattr(tarfile, "data_filter"):  # from Python 3.11.4 on
            archive.extraction_filter = tarfile.data_filter
        archive.extractall(folder)  # noqa: S202  # filtered where Python can
    return next(path for path in folder.iterdir() if path.is_dir())


@dataclass(frozen=True)
class Served:
    """Resource strings by role and wire."""

    wires: dict[str, dict[str, Any]]

    def resource(self, role: str, wire: str) -> str:
        return str(self.wires[role][wire])


@pytest.fixture
def served() -> Iterator[Served]:
    """A bench, served by the command itself."""
    with _serving(*(word for role in ROLES for word in ("--offer", f"{role}:{OFFERED.get(role, 'tcp,pty')}"))) as bench:
        yield bench


@pytest.fixture
def served_successors() -> Iterator[Served]:
    """A bench of nothing but successors, on the wires that they have."""
    with serving({}) as bench:
        yield bench


@contextmanager
def serving(models: Mapping[str, str], mains_hz: int = 50) -> Iterator[Served]:
    """Serve the bench of successors with other models in the places that are named, on the wires that they have."""
    text = (HERE.parent / "successors" / "bench.toml").read_text(encoding="utf-8")
    for role, model in models.items():
        text = re.sub(rf'(?m)(^\[{role}\]\nmodel = )"[^"]*"', rf'\1"{model}"', text)
    with TemporaryDirectory() as folder:
        bench = Path(folder) / "bench.toml"
        bench.write_text(text.replace("mains_hz = 50", f"mains_hz = {mains_hz}"), encoding="utf-8")
        with _serving("--bench", str(bench)) as served:
            yield served


@contextmanager
def _serving(*options: str) -> Iterator[Served]:
    words = [sys.executable, "-m", "vcfbench", "sim", "serve", "--speed", "max", "--json", *options]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        assert server.stdout is not None
        try:
            yield Served(json.loads(server.stdout.readline())["instruments"])
        finally:
            server.terminate()
            server.wait(10)


def expected_failures(suite: str) -> dict[str, str]:
    """Return the tests of a suite that the real box fails too, each with the reason."""
    listed = tomllib.loads((HERE / "expected_failures.toml").read_text(encoding="utf-8"))
    return dict(listed.get(suite, {}))
