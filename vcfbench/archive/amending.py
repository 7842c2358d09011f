"""Records amended: a person's words about a run, corrected by a line of its own."""

import getpass
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from vcfbench.archive.recorded import directory_of
from vcfbench.archive.verified import verify_run
from vcfbench.errors import ConfigError
from vcfbench.records.amendments import Amendment, amend
from vcfbench.records.devices import DeviceStore, withdrawn
from vcfbench.records.signing import named_key


class Amended(Struct, frozen=True):
    """An amendment, and the places where the earlier words stay."""

    run: str
    amendment: Amendment
    stays: tuple[str, ...] = ()


def logged_in() -> str:
    """Return login name and host."""
    return f"{getpass.getuser()}@{socket.gethostname()}"


def amend_run(
    run: str | Path, changes: Mapping[str, str], *, reason: str, by: str | None = None, runs: str | Path = "runs"
) -> Amended:
    """Add a line to a record that corrects a person's words about its run; no earlier line is changed.

    Args:
        run: directory of the run, its name under `runs` (or the beginning or end of it, or ``"last"``).
        changes: ``{"dut": "G-018"}``: ``dut``, ``operator``, ``note``, ``checked_by``, ``tags.KEY``, ``customer``;
            an empty text takes it away.
        reason: why.
        by: who; None is who is logged in, and where.
        runs: directory of the records.

    Raises:
        ConfigError: there is no such record, it is damaged, or something cannot be amended.
        BenchError: its run goes on, or it cannot be written.
    """
    directory = directory_of(run, runs)
    record = directory.read()
    by = logged_in() if by is None else by
    key = named_key(None)  # no key that the record names: whose it is nobody knows
    is_signed = record.header.get("signed_by") is not None
    if key is None and is_signed:  # no later signature could vouch for it
        hint = "VCFBENCH_SIGNING_KEY=FILE names the key that signs it"
        raise ConfigError(f"{directory.run}: the amendment was not written: the record is signed", hint=hint)
    if key is not None:
        found, last = verify_run(directory.path), record.lines[-1:]
        unsigned = "what was amended last is not signed" if last and last[0].get("type") == "amendment" else None
        if (why := found.wrong or unsigned) is not None:  # a signature would vouch for that, too
            hint = "see to it" + ("" if is_signed else ", or amend it without a key: VCFBENCH_SIGNING_KEY unset")
            raise ConfigError(f"{directory.run}: the amendment was not written: {why}", hint=hint)
    made = amend(directory.journal, record, changes, reason=reason, by=by, key=key)
    device = next((each.was for each in made.changes if each.field == "dut"), None)
    settings = record.header.get("settings")
    if device is None or not isinstance(settings, dict) or settings.get("dut") != device:
        return Amended(directory.run, made)
    stays = [f"results that used what was known of {device}, as its K_Vc or its noise, still do"]
    with suppress(ConfigError):
        entries = DeviceStore(Path(str(settings.get("devices", "devices")))).entries(device)
        kept = [each for each in entries if each.run == directory.run and each.name not in withdrawn(entries)]
        stays += [
            f"{each.path} is of this run, and stays with {device} until it is withdrawn: "
            f"vcfbench device {device} --withdraw {each.name}"
            for each in kept
        ]
    return Amended(directory.run, made, tuple(stays))
