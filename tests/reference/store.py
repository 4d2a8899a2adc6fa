"""The solutions of ``cases``, kept in ``solutions/``: the integration in Python takes a quarter of an hour.

``make references`` solves what is missing and what has changed. A channel is kept in whole multiples of a power of two
far below what a test can tell, as second differences, which compress to a third.
"""

import hashlib
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from . import machines, newton, solve
from .cases import SAMPLE_TIME_S, Problem, problems

Array = NDArray[np.float64]
FOLDER = Path(__file__).parent / "solutions"


@dataclass(frozen=True)
class Kept:
    """Channels by name, (N+1,) in SI; how often the gear and the frictions changed their state."""

    channels: dict[str, Array]
    events: int


def path_of(problem: Problem) -> Path:
    return FOLDER / (re.sub(r"\W+", "-", problem.name) + ".npz")


def key_of(problem: Problem) -> str:
    """Changes with the equations, their integration, the rig and the command.

    Arrays enter by six digits of their first moments: another machine's rounding does not change them.
    """
    sources = [
        Path(str(module.__file__)).read_text(encoding="utf-8")
        for module in (newton, machines, sys.modules[solve.__module__])
    ]
    rig, moments = problem.rig, []
    for values in (problem.u, problem.gap):
        if values is not None:
            at = np.linspace(0.0, 1.0, len(values))
            moments.append((len(values), *(f"{np.sum(np.abs(values) * at**k):.6g}" for k in range(4))))
            moments.append(tuple(f"{np.sum(np.maximum(values, 0.0) * at**k):.6g}" for k in range(4)))
    said = (rig.elements, rig.effects, rig.sensors, moments, problem.channels, problem.rtol, problem.atol, problem.bits)
    return hashlib.sha256("\n".join([*sources, repr(said)]).encode()).hexdigest()[:32]


def solved(problem: Problem) -> Kept:
    """Integrated now; seconds to a minute."""
    truth = solve(problem.rig, problem.u, SAMPLE_TIME_S, problem.gap, rtol=problem.rtol, atol=problem.atol)
    channels = {name: read(problem, name, values) for name, values in truth.sensors.items()}
    channels |= {"theta_d": truth.theta_d_rad}
    return Kept({name: channels[name] for name in problem.channels or problem.rig.sensors}, truth.events)


def read(problem: Problem, name: str, angle: Array) -> Array:
    """What an encoder shows whose disk is off centre: the phase of a point on a circle about another centre."""
    there = problem.rig.effects.get(f"sensor_{name}", {}).get("eccentricity")
    if there is None:
        return angle
    shift = there["amplitude"] * np.imag(np.exp(1j * there["phase"]) * (np.exp(1j * angle) - 1.0))
    return np.asarray(angle + shift)


def quantum(problem: Problem, values: Array) -> float:
    """The power of two to whose multiples a channel is rounded."""
    return float(2.0 ** np.ceil(np.log2(max(float(np.ptp(values)), 1e-12)) - problem.bits))


def write(problem: Problem) -> None:
    kept, arrays = solved(problem), {}
    for name, values in kept.channels.items():
        unit = quantum(problem, values)
        arrays[f"unit {name}"] = np.array(unit)
        arrays[name] = np.diff(np.round(values / unit).astype(np.int64), n=2, prepend=[0, 0])
    FOLDER.mkdir(exist_ok=True)
    np.savez_compressed(path_of(problem), key=key_of(problem), events=kept.events, **arrays)


def current(problem: Problem) -> bool:
    """Whether what is kept is the solution of this problem by these equations."""
    path = path_of(problem)
    if not path.exists():
        return False
    with np.load(path) as found:
        return str(found["key"]) == key_of(problem)


def stored(problem: Problem) -> Kept:
    """What is kept of a problem; an ``AssertionError`` if that is of another one."""
    assert current(problem), (
        f"the kept solution of '{problem.name}' is missing or old: `make references` solves it anew"
    )
    with np.load(path_of(problem)) as found:
        names = [name[5:] for name in found if name.startswith("unit ")]
        channels = {n: np.cumsum(np.cumsum(found[n])) * float(found[f"unit {n}"]) for n in names}
        return Kept(channels, int(found["events"]))


def main() -> None:
    from joblib import Parallel, delayed

    old = [problem for problem in problems().values() if not current(problem)]
    print(f"{len(old)} of {len(problems())} to solve")
    Parallel(n_jobs=2)(delayed(write)(problem) for problem in old)
    for path in set(FOLDER.glob("*.npz")) - {path_of(problem) for problem in problems().values()}:
        path.unlink()


if __name__ == "__main__":
    main()
