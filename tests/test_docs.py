"""Every command and example of the documentation is run, every link leads somewhere.

Code blocks are marked by what stands behind their three backquotes: `sh` and `python` are run; of a `console` block the
commands behind `$` are run and the lines shown must appear, in that order, in what they print (`...` stands for any);
a `text` block right after a `python` one is what that prints; what ends in `&` runs in the background until the
document tells it to stop, and must then have ended well;
`ci` marks what installs something (the README's two commands, which .ci/run runs), `hardware` what needs a real bench.
A block with a `title="..."`, which the site shows above it, is a file that the reader writes, or with `(add)` adds to.
Digits that a tutorial shows may differ, with the numerical libraries for instance.
"""

from __future__ import annotations

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
from simrack_tests.cells import few
from simrack_tests.ports import free_port

from tests import warm
from tests.conftest import HERE, SLOW
from tests.test_examples import installed

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
VCFBENCH = [sys.executable, "-c", "from vcfbench.cli.main import main; main()"]
KNOWN = {"sh", "sh ci", "sh hardware", "console", "python", "python hardware", "toml", "yaml", "text", ""}
TUTORIALS = ROOT / "docs" / "tutorials"
SITE = {each.name for folder in ("tutorials", "howto", "procedures") for each in (ROOT / "docs" / folder).iterdir()}
LONG = {
    "bench-file.md",
    "live.md",
    "rate-tables.md",
    "console.md",
    "python.md",
    "records.md",
    "reports.md",
    "studies.md",
    "serving.md",
    "simulated-instruments.md",
    "testing.md",
    *SITE,
}
"""Documents whose commands take some seconds each, or need an extra; all others are run every time."""

BLOCK = re.compile(
    r'^```(?P<info>[^\n`"]*?)( title="(?P<title>[^"\n]+)")?\n(?P<body>.*?)^```$', re.MULTILINE | re.DOTALL
)
ADDED = " (add)"
INSTALLED = "pip install -e ."
"""What a reader types who has written a package."""


@dataclass(frozen=True)
class Block:
    info: str
    body: str
    title: str = ""

    def write(self, folder: Path) -> None:
        """Be the file that the title names."""
        path = folder / self.title.removesuffix(ADDED)
        path.parent.mkdir(parents=True, exist_ok=True)
        before = path.read_text(encoding="utf-8") + "\n" if self.title.endswith(ADDED) else ""
        path.write_text(before + self.body, encoding="utf-8")

    def commands(self) -> list[str]:
        lines = self.body.replace("\\\n", " ").splitlines()
        if self.info == "console":
            return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
        return [line for line in lines if line and not line.startswith("#")]

    def shown(self) -> list[str]:
        lines = [" ".join(line.split()) for line in self.body.splitlines() if not line.startswith("$ ")]
        return [line for line in lines if line not in {"", "..."}]


def blocks(document: Path) -> Iterator[Block]:
    for found in BLOCK.finditer(document.read_text(encoding="utf-8")):
        yield Block(found["info"].strip(), found["body"], found["title"] or "")


@contextmanager
def started(command: str, folder: Path) -> Iterator[None]:
    """Start one command line in the background; it is ready once it has printed a line, and must have ended well."""
    words = shlex.split(command)
    assert (words[0], words.pop()) == ("vcfbench", "&")
    with warm.running(words, folder) as process:
        assert process.stdout.readline(), command
        yield
        assert process.wait(30.0) == 0


def run(command: str, folder: Path, *, fresh: bool = False) -> str:
    """Run one command line without a shell, so that Windows runs the same; `> file` is understood.

    `fresh` is in an interpreter of its own, which finds what was installed meanwhile.
    """
    words = shlex.split(f"python -m {command}" if fresh and command.startswith("vcfbench ") else command)
    if words[:2] == ["cp", "-r"]:
        shutil.copytree(folder / words[2], folder / words[3], dirs_exist_ok=True)
        return ""
    target = folder / words.pop() if ">" in words else None
    if target is not None:
        assert words.pop() == ">"
    done = module_run(words, folder) if words[:2] == ["python", "-m"] else warm.run(words, folder)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr
    if target is not None:
        target.write_text(done.stdout, encoding="utf-8")
    return done.stdout


def module_run(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run ``python -m MODULE`` in a fresh interpreter."""
    command = [sys.executable, *words[1:]]
    environment = {**os.environ, "PYTHONUTF8": "1"}
    return subprocess.run(  # noqa: S603 - our own documentation
        command, cwd=folder, env=environment, capture_output=True, encoding="utf-8", timeout=120, check=False
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A working directory that looks like a clone to the commands."""
    for name in ("examples", "benchmarks", "experiments"):
        shutil.copytree(ROOT / name, tmp_path / name)
    return tmp_path


def ids(document: Path) -> str:
    return document.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("document", few(DOCUMENTS, *(each for each in DOCUMENTS if each.name not in LONG)), ids=ids)
def test_what_is_shown_works(document: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_CONTROL_PORT", str(free_port()))  # somebody else may be serving a bench here
    python_printed, fresh = None, False
    with ExitStack() as background:
        for block in blocks(document):
            if block.title:
                block.write(folder)
                continue
            if INSTALLED in block.commands():
                monkeypatch.setenv("PYTHONPATH", str(installed(folder, folder / "site")))
                fresh = True
            if block.info in {"sh", "console"}:
                printed = "\n".join(
                    run_or_start(command, folder, background, fresh=fresh) for command in block.commands()
                )
                if block.info == "console":
                    assert_in_order(block.shown(), printed, exact=document.parent != TUTORIALS)
            if block.info == "text" and python_printed is not None:
                assert block.body == python_printed
            python_printed = run_python(block.body, folder) if block.info == "python" else None


def run_or_start(command: str, folder: Path, background: ExitStack, *, fresh: bool) -> str:
    if not command.endswith("&"):
        return run(command, folder, fresh=fresh)
    background.enter_context(started(command, folder))
    return ""


def run_python(code: str, folder: Path) -> str:
    (folder / "example.py").write_text(code, encoding="utf-8")
    return run("python example.py", folder)


def assert_in_order(expected: list[str], printed: str, *, exact: bool) -> None:
    """`...` within a line stands for any words."""
    seen = (" ".join(line.split()) for line in printed.splitlines()) if exact else without_digits(printed)
    remaining = iter(list(seen))
    for line in expected:
        shown = line if exact else without_digits(line)[0]
        pattern = ".*".join(re.escape(part) for part in shown.split("..."))
        assert any(re.fullmatch(pattern, each) for each in remaining), f"{line!r} is not printed there:\n{printed}"


@pytest.mark.parametrize(("name", "least"), [("own-instrument", 6), ("own-procedure", 3)])
def test_excerpts_of_the_tutorial_are_in_the_example(name: str, least: int) -> None:
    project = ROOT / "examples" / name
    files = [path.read_text(encoding="utf-8") for path in project.rglob("*") if path.suffix in {".py", ".toml"}]
    excerpts = [block.body for block in blocks(TUTORIALS / f"{name}.md") if block.info == "text"]
    assert len(excerpts) >= least
    assert [each for each in excerpts if not any(each in text for text in files)] == []


UNBROKEN = re.compile(r"(?:`[^`]*`|\$[^$]+\$|\S)+")
"""A word, or code or mathematics with its spaces."""


def test_prose_is_wrapped_at_100_characters() -> None:
    for document in (each for each in DOCUMENTS if each.name != "CHANGELOG.md"):
        text = re.sub(r"\$\$.*?\$\$", "", BLOCK.sub("", document.read_text(encoding="utf-8")), flags=re.DOTALL)
        prose = [line for line in text.splitlines() if not line.startswith(("|", "#", "<", "["))]
        long = [line for line in prose if len(line) > 100 and len(UNBROKEN.findall(line.lstrip("-* "))) > 1]
        assert long == [], document


def test_tables_have_no_blank_line_within() -> None:
    """What follows one is no table any more, unless it has a head of its own."""
    broken = [
        f"{document.relative_to(ROOT)}:{text.count(chr(10), 0, found.end()) + 1}"
        for document in DOCUMENTS
        for text in [document.read_text(encoding="utf-8")]
        for found in re.finditer(r"^\|.*\n\n(?=\|)(?!.*\n\|[ :|-]+\|$)", text, re.MULTILINE)
    ]
    assert broken == []


def test_code_blocks_are_marked() -> None:
    unknown = {document.name: {block.info for block in blocks(document)} - KNOWN for document in DOCUMENTS}
    assert {name: infos for name, infos in unknown.items() if infos} == {}


def test_commands_for_hardware_exist(tmp_path: Path) -> None:
    hardware = (each for document in DOCUMENTS for each in blocks(document) if each.info == "sh hardware")
    helps: dict[str, str] = {}
    for command in (each for block in hardware for each in block.commands()):
        options = {word for word in shlex.split(command) if word.startswith("--")}
        words = [word for word in shlex.split(command.split(">")[0]) if not word.startswith("--")]
        asked = " ".join([*words[: 3 if words[1] != "analyze" else 2], "--help"])
        helps[asked] = helps.get(asked) or run(asked, tmp_path)
        assert all(option in helps[asked] for option in options), command


def test_readme_has_the_two_commands_that_ci_runs() -> None:
    commands = [
        command for block in blocks(ROOT / "README.md") if block.info == "sh ci" for command in block.commands()
    ]
    assert commands == [
        "python3 -m venv .venv && . .venv/bin/activate && pip install ./simrack . && vcfbench run virtual-coriolis",
        "pip install '.[test]' && pytest -n auto",
    ]
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    found = re.search(r"grep -E '(.+)' README\.md", script)
    assert found is not None
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [line for line in text.splitlines() if re.search(found[1], line)] == commands


def test_first_link_of_the_readme_is_the_paper() -> None:
    head = "\n".join((ROOT / "README.md").read_text(encoding="utf-8").splitlines()[:10])
    assert re.findall(r"\]\(([^)]+)\)", head)[0] == "docs/evidence/article.md"
    assert "`vcfbench article`" in head


def test_changelog_has_one_topic_per_line_and_no_history() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased = text.split("\n## ")[1]
    topics = {"New", "Changed", "Mended", "Removed", "Known limits"}
    assert {each.split(":")[0] for each in re.findall(r"^### (.*)", unreleased, re.MULTILINE)} <= topics
    assert len(unreleased.split()) < 5000


def test_run_shown_in_the_readme_looks_like_one(tmp_path: Path) -> None:
    """Same words in the same lines; the digits may differ with the seed and the numerical libraries."""
    shown = next(block.body for block in blocks(ROOT / "README.md") if block.body.startswith("quantity"))
    printed = run("vcfbench run virtual-coriolis --quiet", tmp_path)
    lines = [line for line in without_digits(printed) if not line.startswith(("record:", "more:"))]
    head, tail = (without_digits(part) for part in shown.split("...\n"))
    assert lines[: len(head)] == head
    assert lines[-len(tail) :] == tail


def test_readme_and_picture_have_numbers_of_command(tmp_path: Path) -> None:
    shown = next(block.body for block in blocks(ROOT / "README.md") if block.body.startswith("quantity"))
    printed = run("vcfbench run virtual-coriolis --quiet", tmp_path)
    # The estimate of the bench time differs by a hair with what ran before
    assert shown.split("...\n")[0] in printed
    pictured = (ROOT / "docs" / "run.svg").read_text(encoding="utf-8").replace("&#160;", " ")
    found = re.search(r"^K_Vc, rate per volt of V_Vc +([\d.]+)", printed, re.MULTILINE)
    drawn = re.search(r"K_Vc = ([\d.]+)", pictured)
    assert found is not None
    assert drawn is not None
    assert found[1] == f"{float(drawn[1]):.1f}"  # in the picture it is a setting, with all its digits


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_the_picture_in_the_readme_is_what_a_terminal_shows(tmp_path: Path) -> None:
    svg = ET.parse(ROOT / "docs" / "run.svg")  # noqa: S314 - our own picture
    pictured = []
    for screen in svg.iter("{http://www.w3.org/2000/svg}g"):
        if "screen" in screen.get("class", "").split():
            rows: dict[float, str] = {}
            for text in screen.iter("{http://www.w3.org/2000/svg}text"):
                height = float(text.get("y", "0"))
                rows[height] = rows.get(height, "") + (text.text or "").replace("\xa0", " ")
            pictured += [line for line in rows.values() if line.strip() and line != "vcfbench"]
    assert len(pictured) >= 60
    passing = ("average # readings", "reading # of #", "table #, reads #", "left, ends", "$ vcfbench", "record:")
    lines = {line for line in without_digits("\n".join(pictured)) if not any(each in line for each in passing)}
    assert lines <= set(without_digits(on_a_terminal(tmp_path)))


@pytest.mark.exhaustive
def test_readme_shows_first_page_of_report(tmp_path: Path) -> None:
    """Words, ticks among them, are the same; how lines are drawn may differ with Matplotlib."""
    script = runpy.run_path(str(ROOT / "docs" / "make_figures.py"))
    script["draw"](tmp_path)
    name = script["NAME"]
    assert f"](docs/{name})" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert words_of(tmp_path / name) == words_of(ROOT / "docs" / name)


def words_of(svg: Path) -> list[str]:
    """Return the words of a picture but for names of records, days and seals."""
    text = " ".join(ET.parse(svg).getroot().itertext())  # noqa: S314  # ours
    return re.sub(r"\d{8}T\d{6}Z-[\w-]+|\d{4}-\d\d-\d\d|[0-9a-f]{64}", "#", text).split()


def on_a_terminal(folder: Path) -> str:
    """Return what a run of the four steps prints on a terminal, every line that was there for a while."""
    import pty  # noqa: PLC0415  # there is none on Windows

    ours, its = pty.openpty()
    environment = {**os.environ, "COLUMNS": "80", "TERM": "xterm"}
    command = [*VCFBENCH, "run", "virtual-coriolis"]
    with subprocess.Popen(command, cwd=folder, env=environment, stdout=its, stderr=its) as process:  # noqa: S603
        os.close(its)
        printed = b""
        with suppress(OSError):  # the run is over, nobody has the other end any more
            while more := os.read(ours, 100_000):
                printed += more
        os.close(ours)
    assert process.returncode == 0
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]|\r", "\n", printed.decode())


def without_digits(text: str) -> list[str]:
    return [re.sub(r"[-+]?\d+(\.\d+)?", "#", " ".join(line.split())) for line in text.strip().splitlines()]


def anchors(document: Path) -> set[str]:
    text = BLOCK.sub("", document.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_links_lead_somewhere() -> None:
    texts = {document: BLOCK.sub("", document.read_text(encoding="utf-8")) for document in DOCUMENTS}
    for document, text in texts.items():
        for link in re.findall(r"\]\(([^)\s]+)\)", text):
            if "://" in link:
                continue
            path, _, anchor = link.partition("#")
            target = (document.parent / path) if path else document
            assert target.exists(), (document, link)
            assert not anchor or anchor in anchors(target), (document, link)


def test_what_is_called_slow_exists() -> None:
    assert all((HERE / module).exists() for module in SLOW)
