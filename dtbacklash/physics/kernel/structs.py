"""A plant and its state as the core takes them: the addresses of their arrays in the structs of ``plant.h``."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

from dtbacklash.core.library import buffer, ffi, struct
from dtbacklash.physics.kernel import laws
from dtbacklash.physics.kernel import plant as pl
from dtbacklash.physics.kernel.plant import Plant, State

#: structs of so many plants are kept: one is asked for again and again, and it takes longer to make than a short pass
PLANTS_MAX = 32

ARRAYS = (
    "E", "P1", "P2", "A", "G", "slot", "first", "link", "link_ends", "friction_ends", "circuit", "screw", "sensor",
    "sensor_whole", "sensor_tick", "sensor_part", "sensor_play",
)  # fmt: skip
SCALARS = (
    "levels", "substeps", "position", "current", "rotor", "driven", "lag", "limited", "loaded", "has_base", "imposed",
    "forced", "delay_whole", "delay_ticks", "delay_part", "sample_time",
)  # fmt: skip
_kept: dict[int, tuple[Plant, Any]] = {}
_keeping = Lock()
#: struct of a plant -> the parameters of its laws, which have to be there as long
_parameters: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()


def plant_struct(P: Plant) -> Any:
    """The struct of a plant."""
    with _keeping:
        known = _kept.get(id(P))
        if known is None or known[0] is not P:
            while len(_kept) >= PLANTS_MAX:
                del _kept[next(iter(_kept))]
            known = _kept[id(P)] = P, _struct(P)
        return known[1]


def state_struct(S: State) -> Any:
    """The struct of a state."""
    return struct("State", **S._asdict())


def _struct(P: Plant) -> Any:
    law_p, entries = buffer(P.law_p), _laws(P)
    for entry in range(len(P.law)):
        entries[entry].p = law_p + entry * P.law_p.shape[1]
    made = struct("Plant", **{name: getattr(P, name) for name in (*ARRAYS, *SCALARS)}, **sizes(P), law=entries)
    _parameters[made] = law_p
    return made


def _places(P: Plant) -> list[int]:
    """(N_SLOTS + 1,) where the places of each slot begin, and where the last one ends."""
    return [*P.slot.tolist(), len(P.first) - 1]


def calls(P: Plant) -> Iterator[tuple[int, list[laws.Called]]]:
    """The entries of a plant's laws by their numbers, with what is called; not those at places that were taken out."""
    starts, first, rows = _places(P), P.first.tolist(), P.law.tolist()
    for number, kinds in laws.SLOTS.items():
        for place in range(starts[number], starts[number + 1]):
            slot = kinds[(place - starts[number]) % len(kinds)]
            for entry in range(first[place], first[place + 1]):
                yield entry, laws.called(slot, rows[entry][0])


def _laws(P: Plant) -> Any:
    """The structs of a plant's laws, without their parameters; those at places that were taken out are empty."""
    entries = ffi.new("Law[]", max(len(P.law), 1))
    for entry, found in calls(P):
        entries[entry].at = int(P.law[entry, 1])
        laws.fill(entries[entry], found)
    return entries


def sizes(P: Plant) -> dict[str, int]:
    """What the struct of a plant says of its arrays."""
    return {
        "n": P.A.shape[1], "channels": P.G.shape[1], "bodies": P.n_bodies, "links": len(P.link),
        "frictions": len(P.friction_ends), "sensors": len(P.sensor), "depth": int(P.sensor_whole.max(initial=0)) + 1,
        "acts": _acting(P), "remembers": int(_remembers(P)),
    }  # fmt: skip


def _acting(P: Plant) -> int:
    """A bit for each slot in which a law stands."""
    starts = _places(P)
    return sum(int(P.first[starts[k]] < P.first[starts[k + 1]]) << k for k in range(pl.N_SLOTS))


def _remembers(P: Plant) -> bool:
    """Whether a spring has a memory."""
    places = [P.slot[pl.LINK] + pl.PER_LINK * j + pl.MEMORIES for j in range(len(P.link))]
    return any(P.first[place] < P.first[place + 1] for place in places)
