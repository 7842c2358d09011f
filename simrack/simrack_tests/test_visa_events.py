"""Service requests through PyVISA in one's own process: status byte, queue, handlers."""

from __future__ import annotations

from threading import Event
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from pyvisa.constants import EventMechanism, EventType, StatusCode

if TYPE_CHECKING:
    from collections.abc import Iterator

SRQ, QUEUE, HANDLER = EventType.service_request, EventMechanism.queue, EventMechanism.handler


@pytest.fixture
def meter(request: pytest.FixtureRequest) -> Iterator[Any]:
    manager = pyvisa.ResourceManager(f"?speed={getattr(request, 'param', 'max')}&models=34461A@simrack")
    yield manager.open_resource("TCPIP0::34461A::inst0::INSTR", timeout=5_000)
    manager.close()


def test_request_is_one_event_until_status_byte_is_read(meter: Any) -> None:
    meter.enable_event(SRQ, QUEUE)
    meter.write("*CLS;*ESE 1;*SRE 32;:INIT;*OPC")
    assert not meter.wait_on_event(SRQ, 5_000).timed_out
    assert meter.wait_on_event(SRQ, 100, capture_timeout=True).timed_out
    assert meter.read_stb() & 96 == 96
    assert meter.read_stb() & 96 == 32
    assert meter.query("*ESR?").strip() == "+1"
    meter.write("INIT;*OPC")
    assert not meter.wait_on_event(SRQ, 5_000).timed_out


def test_queued_events_can_be_discarded_and_need_enabling(meter: Any) -> None:
    with pytest.raises(pyvisa.VisaIOError) as caught:
        meter.wait_on_event(SRQ, 0)
    assert caught.value.error_code == StatusCode.error_not_enabled
    meter.enable_event(SRQ, QUEUE)
    meter.write("*CLS;*ESE 32;*SRE 32;:WHAT")
    meter.discard_events(SRQ, QUEUE)
    assert meter.wait_on_event(SRQ, 0, capture_timeout=True).timed_out
    meter.disable_event(SRQ, QUEUE)


def test_a_handler_is_called_while_time_passes(meter: Any) -> None:
    heard: list[tuple[int, Any]] = []

    def handler(resource: Any, event: Any, user: Any) -> None:
        assert event.event_type == SRQ
        heard.append((resource.read_stb(), user))

    wrapped = meter.wrap_handler(handler)
    with pytest.raises(pyvisa.VisaIOError, match="HNDLR"):
        meter.enable_event(SRQ, HANDLER)
    user = meter.install_handler(SRQ, wrapped, "mine")
    meter.enable_event(SRQ, HANDLER)
    meter.write("*CLS;*SRE 16;:READ?")
    assert heard == []
    meter.visalib.clock.sleep_until(meter.visalib.clock.now() + 5.0)
    meter.read()
    meter.write("*SRE 32;*ESE 32;:WHAT")
    assert [byte & 112 for byte, _ in heard] == [80, 96]
    assert heard[0][1] == "mine"
    meter.disable_event(SRQ, HANDLER)
    meter.uninstall_handler(SRQ, wrapped, user)


@pytest.mark.parametrize("meter", ["1"], indirect=True)
def test_handler_is_called_by_thread_in_real_time(meter: Any) -> None:
    heard = Event()
    wrapped = meter.wrap_handler(lambda *_: heard.set())
    meter.install_handler(SRQ, wrapped)
    meter.write("*CLS;*ESE 1;*SRE 32;:CONF:VOLT:DC 10;:VOLT:DC:NPLC 0.02;:INIT;*OPC")
    meter.enable_event(SRQ, HANDLER)
    assert heard.wait(5.0)
    assert meter.read_stb() & 64
    meter.disable_event(SRQ, HANDLER)


def test_what_has_no_poll_announces_nothing() -> None:
    manager = pyvisa.ResourceManager("?speed=max&models=34461A:tcp@simrack")
    meter = manager.open_resource("TCPIP0::34461A::5025::SOCKET")
    with pytest.raises(pyvisa.VisaIOError) as caught:
        meter.enable_event(SRQ, QUEUE)
    assert caught.value.error_code == StatusCode.error_nonsupported_operation
    manager.close()
