"""A VISA library that a bench file names by its file is a program: it runs only after confirmation."""

from __future__ import annotations

from hashlib import sha256
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

import vcfbench
from vcfbench.bench.check import check_bench
from vcfbench.cli.main import app
from vcfbench.errors import BenchError, ConfigError
from vcfbench.safety.trust import VARIABLE, Trust, require_library, require_trust
from vcfbench.station.writing import bench_text
from vcfbench.testing.benches import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from vcfbench.station.description import BenchDescription

NO_LIBRARY = b"no library"
SHA_256 = sha256(NO_LIBRARY).hexdigest()


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[BenchDescription]:
    """Return a served bench whose library is a file that is none."""
    monkeypatch.delenv(VARIABLE, raising=False)
    (tmp_path / "libvisa.so").write_bytes(NO_LIBRARY)
    with serve_simulated() as lab:
        yield replace(lab.on_wires(), visa_library=str(tmp_path / "libvisa.so"))


@pytest.mark.parametrize(
    "use",
    [
        vcfbench.open_bench,
        check_bench,
        lambda bench: vcfbench.run("turntable", bench, runs="not-made"),
        lambda bench: vcfbench.start("turntable", bench, runs="not-made").result(),
    ],
)
def test_a_library_that_nobody_trusts_is_not_loaded(
    use: Callable[[BenchDescription], object], bench: BenchDescription, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as refused:
        use(bench)
    assert f"the VISA library {bench.visa_library} (SHA-256 {SHA_256}): it runs only after" in str(refused.value)
    assert f"trust=True from Python, or VCFBENCH_TRUST={SHA_256}" in (refused.value.hint or "")
    assert not (tmp_path / "not-made").exists()


def test_a_library_that_somebody_trusts_is_loaded(bench: BenchDescription, monkeypatch: pytest.MonkeyPatch) -> None:
    """This one cannot be, and PyVISA says so."""
    asked: list[str] = []
    for trust in (True, lambda words: not asked.append(words)):  # type: ignore[func-returns-value]
        with pytest.raises(BenchError, match=r"libvisa\.so.*(invalid|short|header)"):
            vcfbench.open_bench(bench, trust=trust)
    assert asked == [f"the VISA library {bench.visa_library} (SHA-256 {SHA_256})"]
    monkeypatch.setenv(VARIABLE, f"{'0' * 64}, {SHA_256.upper()}")
    require_library(bench, trust=False)


@pytest.mark.parametrize(("library", "is_file"), [("@py", False), ("@ivi", False), ("x@py", False), ("x@ivi", True)])
def test_what_pyvisa_finds_by_itself_is_no_file(library: str, bench: BenchDescription, *, is_file: bool) -> None:
    named = replace(bench, visa_library=library)
    if is_file:
        with pytest.raises(ConfigError, match="the system looks for it"):
            require_library(named, trust=False)
    else:
        require_library(named, trust=False)


def test_a_simulated_bench_loads_no_library_that_it_names() -> None:
    require_library(replace(vcfbench.load_bench("paper"), visa_library="/somewhere/libvisa.so"), trust=False)


@pytest.mark.parametrize("trust", [False, lambda _: False])
def test_library_without_file_is_refused(trust: Trust, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        require_trust("the procedure", tmp_path / "none.py", trust, "add ")
    assert "none.py (SHA-256 unknown: the system looks for it): it runs only after" in str(refused.value)
    assert refused.value.hint == "add --yes, trust=True from Python"


@pytest.mark.parametrize("command", ["run turntable --quiet", "bench check", "talk"])
def test_commands_without_a_terminal_refuse_it(command: str, bench: BenchDescription, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(bench_text(bench), encoding="utf-8")
    done = CliRunner().invoke(app, [*command.split(), "--bench", str(path)])
    assert done.exit_code == ConfigError.exit_code
    assert f"SHA-256 {SHA_256}): it runs only after you confirm it" in done.stderr


def test_making_safe_asks_nobody(bench: BenchDescription) -> None:
    """Whoever makes a bench safe is in a hurry; here the library cannot be loaded."""
    assert "too short" in str(vcfbench.safe_bench(bench).failure())
