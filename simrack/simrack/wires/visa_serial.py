"""Settings and pins of a serial line by their VISA names (VPP-4.3, 5.1.9)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyvisa.constants import ControlFlow, LineState, Parity, ResourceAttribute

from simrack.wires.handshake_line import HandshakeLine
from simrack.wires.serial_line import CharacterFrame
from simrack.wires.serial_line import Parity as LineParity

_SETTINGS = {
    ResourceAttribute.asrl_baud_rate: 9600,
    ResourceAttribute.asrl_data_bits: 8,
    ResourceAttribute.asrl_parity: Parity.none,
    ResourceAttribute.asrl_stop_bits: 10,
    ResourceAttribute.asrl_flow_control: ControlFlow.none,
}
"""What VISA sets up when nothing is said; stop bits in tenths."""
_PARITIES: dict[int, LineParity] = {Parity.even: "even", Parity.odd: "odd"}


def configure(line: HandshakeLine, attributes: Mapping[int, Any]) -> None:
    """Set the controller's end of `line` as the session's attributes say."""
    settings = {name: attributes.get(name, usual) for name, usual in _SETTINGS.items()}
    frame = CharacterFrame(
        float(settings[ResourceAttribute.asrl_baud_rate]),
        int(settings[ResourceAttribute.asrl_data_bits]),
        _PARITIES.get(settings[ResourceAttribute.asrl_parity], "none"),
        settings[ResourceAttribute.asrl_stop_bits] / 10,
    )
    flow = settings[ResourceAttribute.asrl_flow_control]
    line.configure(frame, handshake=bool(flow & ControlFlow.dtr_dsr), xonxoff=bool(flow & ControlFlow.xon_xoff))


def changed(line: HandshakeLine, attributes: Mapping[int, Any], attribute: int) -> None:
    """Let a setting that was changed have its effect."""
    if attribute in _SETTINGS:
        configure(line, attributes)
    elif attribute == ResourceAttribute.asrl_dtr_state:
        line.dtr = attributes[attribute] == LineState.asserted
    elif attribute == ResourceAttribute.asrl_break_state and attributes[attribute] == LineState.asserted:
        line.send_break()


def pin(line: HandshakeLine, attribute: int) -> LineState | None:
    """Return the state of a pin, None for other attributes; the cable joins CTS to RTS, which is always true."""
    states = {
        ResourceAttribute.asrl_dsr_state: line.dsr,
        ResourceAttribute.asrl_dtr_state: line.dtr,
        ResourceAttribute.asrl_cts_state: True,
        ResourceAttribute.asrl_rts_state: True,
    }
    if attribute not in states:
        return None
    return LineState.asserted if states[ResourceAttribute(attribute)] else LineState.unasserted
