from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vcfbench.errors import ConfigError
from vcfbench.files import DEEPEST, kept_from_forks, parse_toml, read_file, read_text, shown

MOST = 100


def test_file_is_read_with_or_without_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfname")
    assert read_text(tmp_path / "a", "a file") == "name"
    assert read_file(tmp_path / "a", "a file", MOST) == b"\xef\xbb\xbfname"


def test_file_of_the_largest_size_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * MOST)
    assert len(read_file(tmp_path / "a", "a file", MOST)) == MOST
    (tmp_path / "a").write_bytes(b"x" * (MOST + 1))
    with pytest.raises(ConfigError, match="a: expected a file of at most 100 bytes, this file has more"):
        read_file(tmp_path / "a", "a file", MOST)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no FIFOs")
def test_what_is_no_regular_file_is_named_and_never_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "link").symlink_to("fifo")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
        for name, what in {
            "fifo": "a pipe",
            "link": "a pipe",
            "socket": "a socket",
            ".": "a directory",
            "/dev/zero": "a device",
        }.items():
            with pytest.raises(ConfigError, match=f"expected a bench file, this is {what}"):
                read_file(tmp_path / name, "a bench file", MOST)


def test_what_cannot_be_read_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for name in ("loop", "x" * 300, "\0", "\udcff", "file/below"):
        with pytest.raises(ConfigError, match="expected a file, ") as caught:
            read_file(tmp_path / name, "a file", MOST)
        assert str(caught.value).isprintable()


def test_names_that_would_write_on_the_terminal_are_quoted() -> None:
    assert shown("a b.toml") == "a b.toml"
    assert shown("a\x1b[2J\n") == "'a\\x1b[2J\\n'"
    assert shown("") == "''"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = " + "[" * 5000, "f: expected TOML: nested too deeply"),
        ("x = " + "[" * 40 + "]" * 40, "f: x[0][0]: expected TOML: nested too deeply, 32 at most"),
        (".".join("a" * 3000) + " = 1", "f: expected TOML with keys of at most 32 parts, got a longer one"),
        (".".join("a" * 400_000) + " = 1", "f: expected TOML with keys of at most 32 parts, got a longer one"),
        ("[" + " . ".join(["'a b'"] * 40) + "]", "f: expected TOML with keys of at most 32 parts"),
        ("a.b = [1.0, inf]", "f: a.b[1]: expected a finite number, got inf"),
        ("a = {'b c' = nan}", "f: a.'b c': expected a finite number, got nan"),
        ("a = 1e-320", "f: a: expected zero or a number of at least 2.2e-308 either sign, got 1e-320"),
        ("a = 1e400", "f: a: expected a finite number, got inf"),
        ("a = 9223372036854775808", "f: a: expected a whole number of 64 bits, got a longer one"),
        ("a = 0x" + "f" * 9000, "f: a: expected a whole number of 64 bits, got a longer one"),
        ("a = " + "1" * 9000, "f: expected TOML: "),
        ("a = 1\na = 2", "f: expected TOML: Cannot overwrite a value"),
    ],
)
def test_what_no_setting_is_is_one_sentence(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_toml(text, "f")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("text", "said", "cure"),
    [
        ("b = 1\na = 2\nb = 3\n", "line 3, column 6): b = 3;", "stands above already"),
        ("[x]\n[y]\n[x]\n", "line 3, column 3): [x];", "the table stands above already"),
        ("[site]\nlatitude_deg = 37,9\n", "line 2, column 18): latitude_deg = 37,9;", "a decimal point, not a comma"),
        ("day = 01-15-2026", "day = 01-15-2026;", "write a day as 2026-01-15"),
        ("day = 15.01.2026", "day = 15.01.2026;", "write a day as 2026-01-15"),
        ("day = 2026-02-30", "day = 2026-02-30;", "write a day as 2026-01-15"),
        ("name = lab", "name = lab;", 'a text in quotes: "..."'),
        ("name = \u201clab\u201d", "name = \u201clab\u201d;", "straight quotes"),
        ('name = "lab\nx = 1', 'name = "lab;', "a quote at the end of the text"),
        ('name = "lab', 'name = "lab;', "a quote at the end of the text"),
        ('path = "C:\\Users"', 'path = "C:\\Users";', "write / for"),
        ("gain = .5", "gain = .5;", "on both sides of the decimal point"),
        ("limit = 12 V", "limit = 12 V;", "the number alone"),
        ("yes = True", "yes = True;", "in small letters"),
        ("a = [1, 2\nb = 3", "b = 3;", "close the bracket"),
        ("limit 12", "limit 12;", "KEY = VALUE"),
        ("limit = # none", "limit = # none;", "a value behind ="),
    ],
)
def test_a_slip_in_toml_is_told_with_its_line_and_its_cure(text: str, said: str, cure: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_toml(text, "f")
    assert str(caught.value).startswith("f: expected TOML: ")
    assert said in str(caught.value)
    assert cure in (caught.value.hint or "")


def test_key_with_most_parts_is_read() -> None:
    table = parse_toml(".".join("a" * DEEPEST) + " = 1.5\nb = ['a.b.c. d']", "f")
    for _ in range(DEEPEST):
        table = table["a"]
    assert table == 1.5


@given(st.text(alphabet="ab.\"'=[]{},#\n 019_-+einfx\\tuU", max_size=300))
@example('a = """\n"""')
def test_any_text_is_a_table_or_one_sentence(text: str) -> None:
    try:
        parse_toml(text, "f")
    except ConfigError as error:
        words = str(error)
    else:
        words = "f: a table"
    assert words.startswith("f: ")
    assert words.isprintable()


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux")
def test_file_of_unknown_size_is_read_completely() -> None:
    """As does one that grows while it is read."""
    path = Path("/proc/self/status")
    assert path.stat().st_size == 0
    assert b"VmRSS" in read_file(path, "a table", 100_000)
    with pytest.raises(ConfigError, match="of at most 10 bytes, this file has more"):
        read_file(path, "a table", 10)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows forks no process")
def test_released_descriptor_does_not_unprotect_its_successor(tmp_path: Path) -> None:
    with (tmp_path / "mine").open("wb") as mine, kept_from_forks(mine.fileno()):
        with kept_from_forks(mine.fileno()):
            pass
        if (child := os.fork()) == 0:
            os.write(mine.fileno(), b"from the fork")
            os._exit(0)
        os.waitpid(child, 0)
    assert (tmp_path / "mine").read_bytes() == b""
