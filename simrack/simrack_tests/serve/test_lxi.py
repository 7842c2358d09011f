"""Identification over HTTP, asked for by Python's client and by hand."""

from __future__ import annotations

from contextlib import suppress
from http.client import HTTPConnection
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
from simrack.serve import ServerSettings

from simrack_tests.serve.lamp import Served, served_lamp
from simrack_tests.serve.test_raw import Wire

if TYPE_CHECKING:
    from collections.abc import Iterator

PATH = "/lxi/identification"
SPACE = "{http://www.lxistandard.org/InstrumentIdentification/1.0}"


@pytest.fixture
def served() -> Iterator[Served]:
    offers = {"lamp": frozenset[str]({"tcp", "hislip", "lxi"})}
    with served_lamp(settings=ServerSettings(offers=offers)) as lamp:  # type: ignore[arg-type]
        yield lamp


def port(served: Served) -> int:
    url = served.resource("lxi")
    assert url.endswith(PATH)
    return int(url.removesuffix(PATH).rpartition(":")[2])


def asked(served: Served, method: str, path: str) -> tuple[int, str | None, bytes]:
    connection = HTTPConnection("127.0.0.1", port(served), timeout=5.0)
    connection.request(method, path)
    answer = connection.getresponse()
    found = answer.status, answer.getheader("Content-Type"), answer.read()
    connection.close()
    return found


def test_it_says_what_idn_says_and_where_the_instrument_answers(served: Served) -> None:
    status, kind, document = asked(served, "GET", PATH)
    root = ET.fromstring(document)  # noqa: S314  (our own)
    assert (status, kind, root.tag) == (200, "text/xml", f"{SPACE}LXIDevice")
    names = ("Manufacturer", "Model", "SerialNumber", "FirmwareRevision", "IdentificationURL")
    assert [root.findtext(SPACE + name) for name in names] == ["Nobody", "Lamp", "0", "1.0", served.resource("lxi")]
    places = [each.text for each in root.iter(f"{SPACE}InstrumentAddressString")]
    assert places == [served.resource("tcp"), served.resource("hislip")]  # the serial line is no place on a network


def test_other_pages_are_missing_and_head_has_no_body(served: Served) -> None:
    assert asked(served, "GET", "/")[0] == 404
    assert asked(served, "HEAD", f"{PATH}/") == (200, "text/xml", b"")


def test_a_request_may_come_in_parts_and_not_be_endless(served: Served) -> None:
    wire = Wire(port(served))
    wire.send(b"GET /LXI/Identif")
    assert wire.silent()
    wire.send(b"ication HTTP/1.0\r\nHost: x\r\n\r\n")
    assert wire.line() == b"HTTP/1.1 200 OK\r\n"
    wire.close()
    endless = Wire(port(served))
    endless.send(b"x" * (1 << 14))
    with suppress(ConnectionError):
        assert endless.socket.recv(1) == b""
    endless.close()
    idle = Wire(port(served))
    assert asked(served, "GET", PATH)[0] == 200
    idle.close()
