from __future__ import annotations

import io
import os

from vcfbench.reports.outlet import Outlet


def written(stream: io.StringIO, *texts: str) -> str:
    outlet = Outlet(stream)
    outlet.open()
    for text in texts:
        outlet.write(text)
    outlet.close()
    return stream.getvalue()


def test_everything_is_written_in_order() -> None:
    texts = [f"{number}\n" for number in range(1000)]
    assert written(io.StringIO(), *texts) == "".join(texts)


def test_unencodable_characters_become_question_marks() -> None:
    reading, writing = os.pipe()
    with open(reading, encoding="ascii") as there, open(writing, "w", encoding="ascii") as stream:  # noqa: PTH123
        outlet = Outlet(stream)
        outlet.open()
        outlet.write("5 \N{DEGREE SIGN}\n")
        outlet.close()
        assert there.readline() == "5 ?\n"


def test_a_pipe_that_nobody_reads_holds_nothing_up() -> None:
    reading, writing = os.pipe()
    with open(reading, "rb") as there, open(writing, "w", encoding="ascii") as stream:  # noqa: PTH123
        outlet = Outlet(stream)
        outlet.open()
        outlet.write(1_000_000 * "x")
        outlet.write("the end")
        assert outlet.behind
        outlet.close()
        assert b"the end" not in there.read1(100_000)


def test_a_broken_pipe_is_not_told() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w", encoding="ascii") as stream:  # noqa: PTH123
        outlet = Outlet(stream)
        outlet.open()
        outlet.write("lost\n")
        outlet.close()
        outlet.write("lost as well\n")
    assert not outlet.isatty()


def test_closed_stream_is_no_terminal() -> None:
    stream = io.StringIO()
    assert not Outlet(stream).isatty()
    stream.close()
    assert not Outlet(stream).isatty()
