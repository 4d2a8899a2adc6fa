"""Draw and record one case: its hidden effects, recordings, test and answer."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from dtbacklash.benchmark.files import DIGITS
from dtbacklash.benchmark.plan import CasePlan
from dtbacklash.errors import Failure
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.rig import SENSOR_PREFIX, Rig
from dtbacklash.prove.conceal import recording_table
from dtbacklash.prove.draw import draw, record
from dtbacklash.prove.secret import Secret, allowed_in
from dtbacklash.scoring.truth import UNLISTED, WRONG_PARAMETER, Hidden, Truth

#: length of a test and of each recording of a pair, s
TEST_S, PAIR_S = 10.0, 15.0
#: by how much the seeds of two recordings of the same machine differ
SEED_STEP = 10_000
#: a motion that makes the machine run away is drawn again, at most so often
ATTEMPTS = 10
#: an effect is added, or grows from this share of its size, or a parameter changes by a factor of this range
CHANGES = ("added", "grown", "parameter")
GROWN_FROM, FACTOR = 0.4, (1.1, 1.3)
CHANGE_STREAM = 7


@dataclass(frozen=True)
class ConcealedCase:
    """One case: tables of its recordings by name, of the test's command, and the answer."""

    recordings: dict[str, pd.DataFrame]
    test_input: pd.DataFrame
    truth: Truth
    noise: dict[str, float]
    resolution: dict[str, float]


def conceal(plan: CasePlan, nominal: Rig) -> ConcealedCase:
    """Make one case of a nominal rig; the same plan gives the same case to the last bit.

    Raises UserError: nothing could be hidden that shows. Failure: no motion keeps the machine within bounds.
    """
    machine = "lifelike" if plan.lifelike else "clean"
    kind = {"unlisted": "unknown", "change": "several"}.get(plan.kind, plan.kind)
    secret = draw(plan.seed, nominal, kind, machine=machine)
    if plan.kind == "change":
        before, secret, change = _draw_pair(secret, nominal, plan.seed)
        tables = {
            "train": _record_again(before, nominal, 0)[1], "train_after": _record_again(secret, nominal, 1)[1],
        }  # fmt: skip
        hidden, allowed = [change], [change.key]
    else:
        tables = {"train": recording_table(secret, nominal, *record(secret, nominal))}
        hidden, allowed = hidden_of(secret, nominal), allowed_in(asdict(secret))
    run, test = _record_again(replace(secret, duration_s=TEST_S), nominal, 2)
    per_si = {name: nominal.sensors[name].per_si for name in secret.channels}
    oracle = {
        name: float(np.sqrt(np.mean((test[name].to_numpy() - run.truth[name] * factor) ** 2)))
        for name, factor in per_si.items()
    }
    truth = Truth(
        plan.number, plan.machine, plan.kind, plan.split, plan.lifelike, hidden, allowed, secret.visibility,
        {name: [float(f"{value:.{DIGITS}g}") for value in test[name]] for name in secret.channels}, oracle,
    )  # fmt: skip
    noise, resolution = (
        {name: sizes[name] * factor for name, factor in per_si.items()} for sizes in (secret.noise, secret.resolution)
    )
    return ConcealedCase(tables, test[["t", "u"]], truth, noise, resolution)


def hidden_of(secret: Secret, nominal: Rig) -> list[Hidden]:
    """The hidden effects and parameters of a secret, in the words of an answer."""
    if secret.kind == "parameters":
        known = nominal.config.parameters
        return [Hidden(name, WRONG_PARAMETER, v, known[name].unit) for name, v in secret.parameters.items()]
    if secret.unknown:
        return [Hidden(secret.unknown["location"], UNLISTED)]
    return [_hidden(effect, nominal) for effect in secret.effects]


def _hidden(effect: dict[str, Any], nominal: Rig) -> Hidden:
    place, name = effect["location"], effect["effect"]
    size = find(nominal.kind_at(place), name, place).size
    unit, value = size.unit, effect["parameters"][size.name]
    if place.startswith(SENSOR_PREFIX) and unit == "sensor's unit":
        unit = nominal.sensors[place.removeprefix(SENSOR_PREFIX)].unit
    return Hidden(place, name, float(value), unit)


def _draw_pair(secret: Secret, nominal: Rig, seed: int) -> tuple[Secret, Secret, Hidden]:
    """A machine before and after one change of its main effect or of a parameter, and the change."""
    rng = np.random.default_rng([seed, CHANGE_STREAM])
    how, (main, *others) = str(rng.choice(CHANGES)), secret.effects
    secret = replace(secret, duration_s=PAIR_S)
    known = {name: p for name, p in nominal.config.parameters.items() if p.tolerance > 0.0}
    if how == "parameter":
        name = str(rng.choice(list(known)))
        value = secret.parameters.get(name, known[name].value) * float(rng.uniform(*FACTOR))
        after = replace(secret, parameters=secret.parameters | {name: value})
        return secret, after, Hidden(name, WRONG_PARAMETER, value, known[name].unit)
    hidden = _hidden(main, nominal)
    if how == "added":
        return replace(secret, effects=others), secret, hidden
    size = find(nominal.kind_at(main["location"]), main["effect"], main["location"]).size.name
    smaller = main | {"parameters": main["parameters"] | {size: GROWN_FROM * main["parameters"][size]}}
    return replace(secret, effects=[smaller, *others]), secret, hidden


def _record_again(secret: Secret, nominal: Rig, which: int) -> tuple[Any, pd.DataFrame]:
    """Record the same machine with another motion and noise; gives the run and its table.

    Raises Failure: no motion keeps the machine within bounds.
    """
    for attempt in range(ATTEMPTS):
        number = which + 3 * attempt
        move = secret.excitation | {"seed": (secret.excitation["seed"] + number) % 2**31}
        again = replace(secret, seed=secret.seed + SEED_STEP * number, excitation=move)
        loop, run = record(again, nominal)
        if not run.diverged:
            return run, recording_table(again, nominal, loop, run)
    raise Failure("seed", secret.seed, f"its {secret.rig} ran away in {ATTEMPTS} further recordings")
