"""A bench that its program has left live: to whom it is left, and for how long it is asked for."""

from __future__ import annotations

import msgspec
import pytest

from tests.cli.test_left_live import CHARGE, PAPER, SAFE, TAKEN
from vcfbench.bench import abandoned
from vcfbench.bench.abandoned import safe_abandoned
from vcfbench.bench.make_safe import MadeSafe
from vcfbench.errors import ConnectFailed
from vcfbench.safety.lock import InUse, Owner

PLAIN = {**CHARGE, "bench": msgspec.to_builtins(PAPER)}


class Tries:
    """What `safe_bench` does, one after the other, the last for ever; the time between is counted, not spent."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        *does: MadeSafe | Exception,
        lives_for_s: float = 0.0,
        dying_for_s: float = 0.0,
    ) -> None:
        self.does = list(does)
        self.now_s = 0.0
        self.made: list[tuple[float, bool]] = []
        monkeypatch.setattr(abandoned, "WallClock", lambda: self)
        monkeypatch.setattr(abandoned, "sleep", self.sleep)
        monkeypatch.setattr(abandoned, "mark_of", lambda pid: "mark" if self.now_s < lives_for_s else f"not {pid}")
        monkeypatch.setattr(abandoned, "dying", lambda pid: pid == 4711 and self.now_s < dying_for_s)
        monkeypatch.setattr(abandoned, "safe_bench", self.safe_bench)

    def now(self) -> float:
        return self.now_s

    def sleep(self, clock: object, seconds: float) -> None:
        assert clock is self
        self.now_s = round(self.now_s + seconds, 3)

    def safe_bench(self, bench: object, *, force: bool = False) -> MadeSafe:
        assert bench == PAPER
        self.made.append((self.now_s, force))
        does = self.does[0] if len(self.does) == 1 else self.does.pop(0)
        if isinstance(does, Exception) and not force:
            raise does
        return does if isinstance(does, MadeSafe) else SAFE


def own() -> InUse:
    error = InUse("in use")
    error.owner = Owner(4711, "Ann", "here", "today", "paper", "COM1")
    return error


def test_the_death_of_the_program_is_waited_for_some_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """As it dies it gives its locks back one by one, and then its wires; one that has left the bench lives on."""
    for lives_for_s, dying_for_s, left, at_s in (
        *((0.35, 0.35, False, 0.4), (60.0, 60.0, False, 5.0), (60.0, 60.0, True, 0.0)),
        (60.0, 0.15, False, 0.2),  # it has become another program, which has nothing of the bench
    ):
        tries = Tries(monkeypatch, SAFE, lives_for_s=lives_for_s, dying_for_s=dying_for_s)
        assert safe_abandoned(PLAIN, left=left) is SAFE
        assert tries.made == [(at_s, False)]


def test_instrument_of_dead_program_is_retried_then_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    held = MadeSafe((), (), left_to={"power": own()})
    tries = Tries(monkeypatch, held, held, SAFE)
    assert safe_abandoned(PLAIN, left=False) is SAFE
    assert tries.made == [(0.0, False), (0.1, False), (0.2, False)]
    tries = Tries(monkeypatch, held)
    safe_abandoned(PLAIN, left=False)
    assert tries.made[-2:] == [(30.1, False), (30.1, True)]
    assert len(tries.made) == 303
    tries = Tries(monkeypatch, own())
    safe_abandoned(PLAIN, left=False)
    assert tries.made[-1] == (5.1, True)


def test_bench_of_another_owner_is_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    both = MadeSafe((), (), left_to={"power": own(), "rate_table": TAKEN})
    Tries(monkeypatch, both)
    with pytest.raises(InUse):  # its own part is not free, and forcing would speak beside the other
        safe_abandoned(PLAIN, left=False)
    for what, left in ((both, True), (MadeSafe((), (), left_to={"power": InUse("nobody has signed")}), False)):
        tries = Tries(monkeypatch, what)
        assert safe_abandoned(PLAIN, left=left) is what
        assert tries.now_s == 0.0
    tries = Tries(monkeypatch, TAKEN)
    assert safe_abandoned(PLAIN, left=False).left_to == {"all": TAKEN}
    assert tries.now_s == 30.1
    tries = Tries(monkeypatch, InUse("nobody has signed"))
    safe_abandoned(PLAIN, left=False)
    assert tries.made[-1] == (5.1, True)
    tries = Tries(monkeypatch, own(), lives_for_s=60.0)
    with pytest.raises(InUse):
        safe_abandoned(PLAIN, left=False)
    assert not any(force for _, force in tries.made)


def test_served_bench_is_waited_for_like_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    tries = Tries(monkeypatch, ConnectFailed("another controls its time"))
    with pytest.raises(ConnectFailed):
        safe_abandoned(PLAIN, left=False)
    assert tries.made[-1] == (5.1, False)
    tries = Tries(monkeypatch, ConnectFailed("another controls its time"), SAFE)
    assert safe_abandoned(PLAIN, left=False) is SAFE
