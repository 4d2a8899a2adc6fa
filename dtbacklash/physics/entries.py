"""The laws of a rig's effects as the compiled simulation reads them: by slot, place and code."""

import numpy as np

from dtbacklash.arrays import Floats, Ints
from dtbacklash.physics.effects.declare import Effect, Values
from dtbacklash.physics.kernel import dispatch
from dtbacklash.physics.kernel import plant as pl

Active = list[tuple[Effect, Values]]

#: slots that leave the linear plant's answer to a held input as it is
BESIDE_NOTHING = (pl.READING, pl.COMMAND)


class Entries:
    """Laws by slot and place; places of a slot are added in the order of its bodies, links, contacts or sensors.

    decays : of each memory the rate at which it falls by itself, 1/s.
    """

    def __init__(self, first_memory: int) -> None:
        self._first_memory = first_memory
        self._places: dict[int, list[list[tuple[int, int, list[float]]]]] = {slot: [] for slot in range(pl.N_SLOTS)}
        self.decays: list[float] = []

    @property
    def forced(self) -> bool:
        """Whether something acts beside the linear plant."""
        return any(there for slot, places in self._places.items() if slot not in BESIDE_NOTHING for there in places)

    def place(self, slot: int, effects: Active, constant: float = 0.0) -> None:
        """Add the next place of a slot with the effects that act there; ``constant`` : a level of friction beside."""
        ordered = sorted(effects, key=lambda pair: getattr(pair[0].slot, "stage", 0))
        number = len(self._places[slot])
        there = [(dispatch.CODES[e.kind, e.name], number, list(values.values())) for e, values in ordered]
        if constant:
            there.insert(0, (dispatch.PLAIN_FRICTION, number, [constant]))
        self._places[slot].append(there)

    def remember(self, slot: int, effects: Active) -> None:
        """Add the next place of a slot whose effects have a memory each."""
        there = []
        for effect, values in effects:
            memory = self._first_memory + len(self.decays)
            there.append((dispatch.CODES[effect.kind, effect.name], memory, list(values.values())))
            decay = getattr(effect.slot, "decay", None)
            self.decays.append(1.0 / values[decay] if decay else 0.0)
        self._places[slot].append(there)

    def arrays(self) -> tuple[Ints, Ints, Ints, Floats]:
        """``slot``, ``first``, ``law`` and ``law_p`` of :class:`~dtbacklash.physics.kernel.plant.Plant`."""
        slots, first, laws, parameters = [], [0], [], []
        for slot in range(pl.N_SLOTS):
            slots.append(len(first) - 1)
            for there in self._places[slot]:
                for code, memory, values in there:
                    laws.append((code, memory))
                    parameters.append(values + [0.0] * (pl.LAW_PARAMETERS - len(values)))
                first.append(len(laws))
        return (
            np.array(slots, dtype=np.int64), np.array(first, dtype=np.int64),
            np.array(laws, dtype=np.int64).reshape(-1, 2),
            np.array(parameters, dtype=float).reshape(-1, pl.LAW_PARAMETERS),
        )  # fmt: skip
