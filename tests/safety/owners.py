"""Who has the wires of one instrument: a model of the protocol of docs/safety.md, small enough to walk through whole.

Five parties as state machines: a run, its watchdog, ``safe``, and a second run, which stands for `resume` too. Each
step is one that the system does in one piece, in the order of the code that is named beside it. `explored` goes through
all interleavings, with up to `FAULTS` deaths, hangs, stopped watchdogs and links that go down, each at any step. A
mistake by name changes the code's order.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

FAULTS = 2
RUN, DOG, SAFE, SECOND = range(4)
NAMES = ("run", "watchdog", "safe", "second run")

MISTAKES = {
    "no look at the path": "a lock on a file that was taken away meanwhile counts (lock._locked)",
    "on before it watches": "outputs go on before the watchdog is ready (open_bench, Watchdog.require_ready)",
    "let go too early": "the watchdog is let go before the bench is safe (Holding.leave)",
    "hung and left alive": "the watchdog does not end a program that hangs (cli.watchdog.Watch._ended)",
    "number alone": "a process is ended by its number (processes.end without a mark)",
    "lock before wires": "the lock is given back before the wires are closed (Holding.leave)",
    "dying is dead": "nobody waits for a process that is dying (Owner.ended_within, bench.abandoned.safe_abandoned)",
    "a full pipe blocks": "a run waits for a watchdog that does not read (safety.watchdog.Watchdog._put)",
    "tries once": "who could not make it safe leaves it so when the link comes back (cli.left_live.make_safe)",
    "left to the first": "the watchdog leaves the bench to a `safe` that dies (bench.abandoned.safe_abandoned)",
}


class State(NamedTuple):
    """All that counts; of each party where it is (`at`), the file that it has opened, and whether it has the wires."""

    at: tuple[str, str, str, str] = ("begin", "", "", "")
    opened: tuple[int, int, int, int] = (0, 0, 0, 0)
    wires: tuple[bool, bool, bool, bool] = (False, False, False, False)
    path: int = 0
    """Which file is at the path of the lock; 0 is none."""
    held: tuple[int, ...] = (-1,) * 6
    """Who has the lock of each file."""
    signed: int = -1
    """Who has signed the file at the path."""
    live: bool = False
    hangs: bool = False
    frozen: bool = False
    """Whether the watchdog is stopped: it does nothing, and its pipe is full."""
    down: bool = False
    """Whether the link is down: nobody can be told; it comes back."""
    reused: bool = False
    """Whether the number of the run, which is dead, was given to another process."""
    died: tuple[bool, bool, bool, bool] = (False, False, False, False)
    faults: int = 0
    said: bool = False
    """Whether somebody has said NOT SAFE: a person goes and looks, should the watchdog die as well."""
    harmed: bool = False
    """Whether a process was ended that has nothing to do with the bench."""


def _with(values: tuple, place: int, value: object) -> tuple:  # type: ignore[type-arg]
    return (*values[:place], value, *values[place + 1 :])


def _to(state: State, who: int, at: str, **more: object) -> State:
    return state._replace(at=_with(state.at, who, at), **more)  # type: ignore[arg-type]


def _gone(state: State, who: int) -> bool:
    return state.died[who] and state.at[who] == "gone"


def _taking(state: State, who: int, refused: str, mistake: str) -> Iterator[State]:
    """Take the lock: `lock._locked`, then `lock._lock`, each system call a step."""
    at, file = state.at[who], state.opened[who]
    if at == "open":
        path = state.path or min(set(range(1, 6)) - set(state.opened) - {f for f, h in enumerate(state.held) if h >= 0})
        yield _to(state, who, "flock", path=path, opened=_with(state.opened, who, path),
                  signed=state.signed if state.path else -1)  # fmt: skip
    elif at == "flock":
        if state.held[file] < 0:
            yield _to(state, who, "look", held=_with(state.held, file, who))
        else:
            yield _to(state, who, refused, opened=_with(state.opened, who, 0))
    elif at == "look":
        if state.path == file or mistake == "no look at the path":
            yield _to(state, who, "sign")
        else:
            yield _to(state, who, "open", held=_with(state.held, file, -1), opened=_with(state.opened, who, 0))
    elif at == "sign":
        dying = state.signed >= 0 and state.died[state.signed] and not _gone(state, state.signed)
        if not dying or mistake == "dying is dead":
            yield _to(state, who, "has it", signed=who if state.path == file else state.signed)


def _giving_back(state: State, who: int, then: str) -> Iterator[State]:
    """Close the wires, take the file away, drop the lock: `SafetyStack.close`, then `lock._lock`."""
    at, file = state.at[who], state.opened[who]
    if at == "close":
        yield _to(state, who, "unlink", wires=_with(state.wires, who, value=False))
    elif at == "unlink":
        yield _to(state, who, "unlock", path=0, signed=-1)
    elif at == "unlock":
        yield _to(state, who, then, held=_with(state.held, file, -1), opened=_with(state.opened, who, 0))


def _run(state: State, mistake: str) -> Iterator[State]:  # noqa: C901  # a row a step
    """A run: `open_bench`, then `Holding.leave`."""
    at, dog = state.at[RUN], state.at[DOG]
    if state.hangs or (state.frozen and mistake == "a full pipe blocks"):
        return
    yield from _taking(state, RUN, "gone", mistake)
    early = mistake == "lock before wires"
    yield from _giving_back(state, RUN, "unclosed" if early else "tell")
    if at == "begin":
        yield _to(state, RUN, "open")
    elif at == "has it":  # the watchdog is started, instruments are opened, it is waited for
        yield _to(_to(state, DOG, "starts"), RUN, "opened", wires=_with(state.wires, RUN, value=True))
    elif at == "opened" and dog == "watches":
        yield _to(state, RUN, "live", live=True)
    elif at == "opened" and (dog == "gone" or mistake == "on before it watches"):
        yield _to(state, RUN, "close" if dog == "gone" else "live", live=dog != "gone")
    elif at == "live":  # it ends, is stopped, or its watchdog has died or is silent
        told = mistake == "let go too early" and dog == "watches"
        yield _to(_to(state, DOG, "gone") if told else state, RUN, "ends")
    elif at == "ends":
        after = "unlink" if early else "close"
        if not state.down:
            yield _to(state, RUN, after, live=False)
        yield _to(state, RUN, after, said=True)  # the watchdog is told so too
    elif at == "unclosed":
        yield _to(state, RUN, "tell", wires=_with(state.wires, RUN, value=False))
    elif at == "tell":
        yield _to(_to(state, DOG, "open" if state.live else "gone") if dog == "watches" else state, RUN, "gone")


def _ended(state: State, mistake: str) -> State:
    """End the run by SIGKILL: `processes.end`."""
    if state.reused:
        return state._replace(harmed=mistake == "number alone")
    return _dies(state, RUN) if not state.died[RUN] and state.at[RUN] != "gone" else state


def _watchdog(state: State, mistake: str) -> Iterator[State]:
    """The watchdog: `cli.watchdog.Watch`, then `bench.abandoned.safe_abandoned`."""
    at = state.at[DOG]
    yield from _taking(state, DOG, "refused", mistake)
    if state.frozen:
        return
    yield from _giving_back(state, DOG, "open" if state.live and mistake != "tries once" else "gone")
    if at == "starts":
        yield _to(state, DOG, "gone" if state.died[RUN] else "watches")
    elif at == "watches" and (state.died[RUN] or state.hangs):
        left = mistake == "hung and left alive"
        yield _to(state if left else _ended(state, mistake), DOG, "has it" if left and state.hangs else "waits")
    elif at == "waits" and (_gone(state, RUN) or mistake == "dying is dead"):
        yield _to(state, DOG, "open")
    elif at == "refused":  # tried again for longer than a `safe` takes; a run has a watchdog of its own
        owner = state.held[state.path] if state.path else -1
        left_to_safe = mistake == "left to the first" and owner == SAFE
        yield _to(state, DOG, "gone" if owner == SECOND or left_to_safe else "open")
    elif at == "has it":
        yield _to(state, DOG, "tells", wires=_with(state.wires, DOG, value=True))
    elif at == "tells":
        yield _to(state, DOG, "close", live=state.live and state.down, said=state.said or state.down)


def _safe(state: State, mistake: str) -> Iterator[State]:
    """``vcfbench safe``, with ``--end-owner`` or without: `safing.safe_bench`."""
    at = state.at[SAFE]
    yield from _taking(state, SAFE, "refused", mistake)
    yield from _giving_back(state, SAFE, "open" if state.live and mistake != "tries once" else "gone")
    if at == "refused":
        yield _to(state, SAFE, "gone")
        if state.signed == RUN:
            yield _to(_ended(state, mistake), SAFE, "open")
    elif at == "has it":
        yield _to(state, SAFE, "tells", wires=_with(state.wires, SAFE, value=True))
    elif at == "tells":
        yield _to(state, SAFE, "close", live=state.live and state.down, said=state.said or state.down)


def _second(state: State, mistake: str) -> Iterator[State]:
    """A second run, or `resume`, that does not die: what it takes over is live until it has made that safe."""
    at = state.at[SECOND]
    yield from _taking(state, SECOND, "gone", mistake)
    yield from _giving_back(state, SECOND, "gone")
    if at == "has it":
        yield _to(state, SECOND, "live", live=True, wires=_with(state.wires, SECOND, value=True))
    elif at == "live" and not state.down:
        yield _to(state, SECOND, "close", live=False)


def _system(state: State, _mistake: str) -> Iterator[State]:
    """What the system does of a process that dies: its locks first, then its wires (descriptors in their order)."""
    for who in (RUN, DOG, SAFE):
        file = state.opened[who]
        if state.at[who] == "dying":
            held = state.held if state.held[file] != who else _with(state.held, file, -1)
            yield _to(state, who, "closing", held=held, opened=_with(state.opened, who, 0))
        elif state.at[who] == "closing":
            yield _to(state, who, "gone", wires=_with(state.wires, who, value=False))
    if _gone(state, RUN) and not state.reused:
        yield state._replace(reused=True)
    if state.down:
        yield state._replace(down=False)


def _dies(state: State, who: int) -> State:
    return _to(state, who, "dying", died=_with(state.died, who, value=True), hangs=state.hangs and who != RUN)


def _faults(state: State) -> Iterator[State]:
    if not state.faults:
        return
    less = state._replace(faults=state.faults - 1)
    for who in (RUN, DOG, SAFE):
        if state.at[who] not in {"", "begin", "gone", "dying", "closing"}:
            yield _dies(less, who)
    if state.at[RUN] in {"opened", "live", "ends", "close"} and not state.hangs:
        yield less._replace(hangs=True)
    if state.at[DOG] in {"watches", "waits", "has it"} and not state.frozen:
        yield less._replace(frozen=True)
    if state.at[RUN] in {"live", "ends"} and not state.down:
        yield less._replace(down=True)


def _steps(state: State, mistake: str) -> Iterator[State]:
    for party in (_run, _watchdog, _safe, _second, _system):
        yield from party(state, mistake)


def _arrivals(state: State) -> Iterator[State]:
    for who in (SAFE, SECOND):
        if not state.at[who]:
            yield _to(state, who, "open")
    if state.frozen:
        yield state._replace(frozen=False)


def wrong(state: State, *, over: bool) -> str | None:
    """Return what must not be of a state; `over`: nothing goes on in it by itself."""
    if sum(state.wires) > 1:
        return "two have the wires: " + ", ".join(name for name, has in zip(NAMES, state.wires, strict=True) if has)
    if state.harmed:
        return "a process was ended that had nothing to do with it"
    if over and state.live:
        if not (state.died[DOG] or state.frozen) or not (state.died[RUN] or state.hangs or state.said):
            return "it is live, and nobody makes it safe"
        if state.signed < 0 and not state.said:
            return "it is live, and the next start does not find out who left it"
    return None


def explored(mistake: str = "", faults: int = FAULTS) -> tuple[int, str | None, list[State]]:
    """Go through all states; return how many, what is wrong with the first that is, and the way to that."""
    first = State(faults=faults)
    before: dict[State, State | None] = {first: None}
    waiting = deque([first])
    while waiting:
        state = waiting.popleft()
        following = list(_steps(state, mistake))
        if found := wrong(state, over=all(each == state or each.reused != state.reused for each in following)):
            way: list[State] = []
            at: State | None = state
            while at is not None:
                way.append(at)
                at = before[at]
            return len(before), found, way[::-1]
        for each in (*following, *_faults(state), *_arrivals(state)):
            if each not in before:
                before[each] = state
                waiting.append(each)
    return len(before), None, []
