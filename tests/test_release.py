"""What a release is made of: one version, wheel and sdist without git, and what an installation leaves behind."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from packaging.specifiers import SpecifierSet

import vcfbench

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOT = Path(__file__).parents[1]
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", "build", "dist", "__pycache__", ".*_cache")
PACKAGES = {"vcfbench", "vcfbench_tables", "pyvisa_vcfbench"}
RACK = {"simrack", "pyvisa_simrack"}
VERSION = re.findall(r'"([\d.]+)"', (ROOT / "simrack" / "simrack" / "_version.py").read_text(encoding="utf-8"))[0]
SCRIPTS = "Scripts" if sys.platform == "win32" else "bin"

pytestmark = pytest.mark.exhaustive


def done(*words: str | Path, folder: Path, also: Mapping[str, str] | None = None) -> str:
    finished = subprocess.run(  # noqa: S603 - our own commands
        words, cwd=folder, env={**os.environ, **(also or {})}, capture_output=True, text=True, check=False
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return finished.stdout


def built(source: Path, into: Path, *what: str) -> dict[str, Path]:
    done(sys.executable, "-m", "build", "--no-isolation", "--outdir", into, *what, ".", folder=source)
    return {path.suffix: path for path in into.iterdir()}


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean copy without git."""
    pytest.importorskip("build", reason="pip install '.[dev]'")
    folder = tmp_path_factory.mktemp("release") / "vcfbench"
    shutil.copytree(ROOT, folder, ignore=LEFT_OUT)
    return folder


@pytest.fixture(scope="module")
def release(source: Path) -> dict[str, Path]:
    """The sdist, and the wheel that is made from it."""
    return built(source, source.parent / "dist")


@pytest.fixture(scope="module")
def rack(source: Path) -> dict[str, Path]:
    """Sdist and wheel of the rack."""
    return built(source / "simrack", source.parent / "rack")


def test_rack_has_the_same_version(rack: dict[str, Path], release: dict[str, Path]) -> None:
    assert sorted(path.name for path in rack.values()) == [
        f"simrack-{VERSION}-py3-none-any.whl",
        f"simrack-{VERSION}.tar.gz",
    ]
    done(sys.executable, "-m", "twine", "check", "--strict", *rack.values(), folder=ROOT)
    metadata = contents(release[".whl"])[f"vcfbench-{VERSION}.dist-info/METADATA"].decode()
    (required,) = re.findall(r"^Requires-Dist: simrack(\S+)$", metadata, re.MULTILINE)
    assert VERSION in SpecifierSet(required)


def test_release_has_the_version_of_its_file(release: dict[str, Path]) -> None:
    assert sorted(path.name for path in release.values()) == [
        f"vcfbench-{VERSION}-py3-none-any.whl",
        f"vcfbench-{VERSION}.tar.gz",
    ]
    done(sys.executable, "-m", "twine", "check", "--strict", *release.values(), folder=ROOT)


def test_the_sdist_makes_the_wheel_that_the_source_makes(release: dict[str, Path], source: Path) -> None:
    direct = built(source, source.parent / "direct", "--wheel")[".whl"]
    assert contents(direct) == contents(release[".whl"])
    assert {name.split("/")[0] for name in contents(direct)} == PACKAGES | {f"vcfbench-{VERSION}.dist-info"}


def test_the_wheel_runs_and_leaves_nothing_else_behind(
    release: dict[str, Path], rack: dict[str, Path], tmp_path: Path
) -> None:
    """What it depends on is taken from here; README's first command installs that too."""
    home = tmp_path / "venv"
    done(sys.executable, "-m", "venv", "--without-pip", home, folder=tmp_path)
    python = home / SCRIPTS / "python"
    where = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(done(python, "-c", where, folder=tmp_path).strip())
    install = ("-m", "pip", "--python", python, "install", "--quiet", "--no-deps", rack[".whl"], release[".whl"])
    done(sys.executable, *install, folder=tmp_path)
    ours = PACKAGES | RACK | {f"vcfbench-{VERSION}.dist-info", f"simrack-{VERSION}.dist-info"}
    assert {path.name for path in site.iterdir()} == ours
    others = os.pathsep.join(path for path in sys.path if path.endswith("site-packages"))
    found = done(python, "-c", "import vcfbench; print(vcfbench.__file__)", folder=tmp_path, also={"PYTHONPATH": ""})
    assert Path(found.strip()).is_relative_to(site)
    (site / "others.pth").write_text(others.replace(os.pathsep, "\n"), encoding="utf-8")
    command = home / SCRIPTS / "vcfbench"
    assert done(command, "--version", folder=tmp_path) == f"vcfbench {VERSION}\n"
    assert "complete:" in done(command, "run", "turntable", "--quiet", folder=tmp_path)
    assert list((tmp_path / "runs").iterdir())


def test_a_tree_that_was_never_installed_says_so(tmp_path: Path) -> None:
    code = "import sys; sys.path.insert(0, sys.argv[1]); import vcfbench; print(vcfbench.__version__)"
    shutil.copytree(ROOT / "vcfbench", tmp_path / "vcfbench", ignore=LEFT_OUT)
    assert done(sys.executable, "-S", "-c", code, str(tmp_path), folder=tmp_path) == "0+unknown\n"
    assert vcfbench.__version__ != "0+unknown"
