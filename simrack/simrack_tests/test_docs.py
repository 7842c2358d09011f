"""Commands and scripts of the pages: they run, and print what the pages say."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import pytest
from simrack.cli import _places
from simrack.faults import Kind
from simrack.plan import plan_of
from simrack.rack import served as served_rack
from simrack.serve import BenchServer, ServedClock, ServerSettings
from simrack.serve.raw import has_ptys

from simrack_tests.cells import few
from simrack_tests.ports import free_port

if TYPE_CHECKING:
    from collections.abc import Iterator

RACK = Path(__file__).parents[1]
PAGES = sorted((RACK / "docs").glob("*.md"))
_BLOCK = re.compile(r"^```(\w*)( ci)?\n(.*?)^```", re.MULTILINE | re.DOTALL)
_PORT = re.compile(r"\b59(\d\d)\b")  # the pages' first port is 5900, of the control port


def blocks(page: Path, language: str) -> list[str]:
    found = _BLOCK.findall(page.read_text(encoding="utf-8"))
    return [text for kind, by_ci, text in found if kind == language and not by_ci]  # .ci/run runs the others


@contextmanager
def served(command: str) -> Iterator[dict[str, Any]]:
    words = [sys.executable, "-m", *command.split(), "--json"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=RACK) as server:  # noqa: S603
        try:
            assert server.stdout is not None
            yield json.loads(server.stdout.readline())
        finally:
            server.terminate()
        assert server.wait(30) == 0


@pytest.mark.parametrize("page", few(PAGES, PAGES[0]), ids=lambda page: page.stem)
def test_a_page_does_what_it_says(
    page: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(RACK)
    first = free_port()

    def moved(text: str) -> str:
        return _PORT.sub(lambda port: str(first + int(port[1])), text)

    commands = [line for block in blocks(page, "sh") for line in moved(block).splitlines()]
    servers = [command for command in commands if command.startswith("simrack serve ")]
    script = moved("\n".join(blocks(page, "python")))
    if not servers:
        assert not commands
        exec(compile(script, page.name, "exec"), {})  # noqa: S102  # our own text
    for command in servers:
        with served(command) as places:
            assert places["instruments"]
            for other in (each for each in commands if each not in servers):
                done = subprocess.run([sys.executable, "-m", *other.split()], check=True, capture_output=True)  # noqa: S603
                assert json.loads(done.stdout)
            exec(compile(script, page.name, "exec"), {})  # noqa: S102
    assert capsys.readouterr().out == "".join(blocks(page, "text"))


@pytest.mark.skipif(not has_ptys(), reason="the page shows serial lines")
def test_what_serve_prints_is_on_the_page() -> None:
    clock = ServedClock(1.0)
    with BenchServer(served_rack(clock), clock, ServerSettings(base_port=free_port())) as server:
        printed = [re.sub(r"\d+(?=::|$)", "N", line) for line in _places(server, plan_of(())).splitlines()]
    (shown,) = [block for block in blocks(RACK / "docs" / "wires.md", "") if "control" in block]
    assert [re.sub(r"\d+(?=::|$)", "N", line) for line in shown.splitlines()] == printed


def test_the_circuit_of_the_page_is_the_example() -> None:
    annotated = (RACK / "examples" / "rc_filter.py").read_text(encoding="utf-8")
    (shown,) = [block for block in blocks(RACK / "docs" / "world.md", "python") if "class RcFilter" in block]
    plain = re.sub(r": float| -> [^:]+|: NDArray[^)]+", "", annotated[annotated.index("class RcFilter") :])
    assert plain == shown[shown.index("class RcFilter") :]


def test_the_script_of_the_readme_is_the_example() -> None:
    script = (RACK / "examples" / "response.py").read_text(encoding="utf-8")
    readme = (RACK / "README.md").read_text(encoding="utf-8")
    assert f"```python\n{script.split(chr(10), 2)[2]}```" in readme
    assert set(re.findall(r"simrack/examples/(\w+\.py)", readme)) == {"response.py", "rc_filter.py", "magnet.py"}


def test_every_class_of_the_table_is_there() -> None:
    named = re.findall(r"`(simrack\.\S+):(\w+)`", (RACK / "docs" / "instruments.md").read_text(encoding="utf-8"))
    assert len(named) == 16
    for module, name in named:
        assert getattr(import_module(module), name).errors_class


def test_every_fault_is_in_the_table() -> None:
    rows = re.findall(r"^\| (`.*?`) \|", (RACK / "docs" / "faults.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert [kind for row in rows for kind in re.findall(r"`(\w+)`", row)] == list(get_args(Kind))
