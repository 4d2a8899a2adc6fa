"""Entries of the catalogue that stand for all of them where each is simulated."""

from collections.abc import Iterable

from dtbacklash.physics.catalogue import CATALOGUE

Key = tuple[str, str]
#: kinds of a simulator's model, which this project's kernel does not move: their laws are those of rotor, carriage and
#: amplifier, and tests/unit/diagnosis/engine/test_models.py has them
OF_A_MODEL = ("turning_joint", "sliding_joint", "joint_drive")
#: what has a solution in closed form: tests/unit/physics/test_delays.py, tests/unit/physics/test_coasting.py
IN_CLOSED_FORM = (("sensor", "moving_average"), *((kind, "coasting") for kind in ("rotor", "carriage", "mass")))


def of_each_law_and_kind(keys: Iterable[Key]) -> list[Key]:
    """The first entry of each law, and the first of each kind that these leave out.

    A law has one function and one slot, whatever it acts on; a kind has one way to its element. Every entry by itself
    is compared with Newton's equations in ``tests/unit/physics/test_truth.py``.
    """
    seen: set[object] = set()
    found = []
    for kind, name in keys:
        if kind in OF_A_MODEL:
            continue
        law = name, type(CATALOGUE[kind, name].slot)
        if not {law, kind} <= seen:
            found.append((kind, name))
            seen |= {law, kind}
    return found
