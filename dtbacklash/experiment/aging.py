"""Changes of the machine itself during a run: ``changes``, a list of times with parameters and effects.

From that time on the plant is the changed rig's, in the same state: positions, speeds, current and gear stay, a new
friction contact begins as its speed says. A change that adds a body or a memory (a screw that begins to yield, an
absorber, hysteresis) is refused.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dtbacklash.config.changes import of_the_change
from dtbacklash.config.run import RunConfig
from dtbacklash.core.library import lib
from dtbacklash.errors import UserError
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.effects.slots import GearPlay
from dtbacklash.physics.kernel.plant import Plant, State, new_state
from dtbacklash.physics.kernel.structs import plant_struct, state_struct
from dtbacklash.physics.rig import Rig, build_rig


def aged_rigs(config: RunConfig, plant: Plant) -> list[tuple[int, Rig, Plant]]:
    """The sample from which on the machine is another one, that machine, and its plant, in order.

    Raises UserError: a parameter that the rig has not, an effect that does not fit, the gear's gap, other bodies than
    those of ``plant``.
    """
    rig, solver, found = build_rig(config.rig), config.solver, []
    for i, change in sorted(enumerate(config.changes), key=lambda one: float(one[1]["at_s"])):
        try:
            rig = _changed(rig, change)
            after = compile_plant(rig, config.sample_time_s, solver.substeps, solver.event_levels)
        except UserError as mistake:
            raise of_the_change(mistake, i) from mistake
        if after.A.shape != plant.A.shape or after.n_bodies != plant.n_bodies:
            allowed = (
                "what keeps the bodies and their memories; a tiny compliance or hysteresis from the beginning may grow"
            )
            raise UserError(f"changes[{i}]", change, allowed)
        found.append((round(float(change["at_s"]) / config.sample_time_s), rig, after))
    return found


def _changed(rig: Rig, change: dict[str, Any]) -> Rig:
    """The rig after a change; raises UserError in the name of the rig."""
    rig = rig.with_parameters({str(name): float(value) for name, value in change.get("parameters", {}).items()})
    for place, there in change.get("effects", {}).items():
        for name, values in there.items():
            rig = _with_effect(rig, str(place), str(name), values)
    return rig


def _with_effect(rig: Rig, place: str, name: str, values: dict[str, Any] | None) -> Rig:
    key = f"rig.effects.{place}.{name}"
    effect = find(rig.kind_at(place), name, key)
    if isinstance(effect.slot, GearPlay):  # the gap is a trace of its own, see `true_half_gap`
        raise UserError(key, values, "does not change here: the gap grows by profile.*")
    if values is None and rig.effect(place, name) is None:
        raise UserError(key, "null", "takes out an effect that the rig has; there is none")
    return rig.with_effect(place, name, values)


def aged_state(plant: Plant, state: State, after: Plant) -> State:
    """The state of the plant ``after``, which goes on where ``plant`` is in ``state``."""
    new = new_state(after)
    for name in ("x", "gear", "lean"):
        getattr(new, name)[:] = getattr(state, name)
    new.commands[: min(new.commands.size, state.commands.size)] = state.commands[: new.commands.size]
    new.commands[state.commands.size :] = state.commands[-1]
    new.seen[:] = state.seen[0]
    new.mode[0] = state.mode[0]
    ends = [tuple(pair) for pair in plant.friction_ends]
    for c, pair in enumerate(after.friction_ends):
        if tuple(pair) in ends:
            new.mode[1 + c] = state.mode[1 + ends.index(tuple(pair))]
        else:
            new.mode[1 + c] = int(np.sign(lib.dtb_slip_rate(plant_struct(after), state_struct(new), c)))
    return new
