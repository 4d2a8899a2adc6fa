"""An FMU for Model Exchange: its archive unpacked, its description read, its library loaded, and it run.

FMPy does so; it is imported where an FMU is read.
"""

from __future__ import annotations

import copy
import functools
import math
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.config.rig import RigConfig
from dtbacklash.errors import UserError

LOADING = threading.Lock()
#: turns in which discrete states find each other, at most
DECISIONS = 100
R = TypeVar("R")


@dataclass(frozen=True, eq=False)
class Model:
    """An FMU, unpacked. states : in its own order. variables : all numbers by name, and elements of arrays.

    arrays : element -> its array (``damping[2]``: ``damping``). own : what each thread has of it. spare : instances of
    threads that have ended.
    """

    path: str
    folder: tempfile.TemporaryDirectory[str]
    description: Any
    states: list[str]
    variables: dict[str, Any]
    arrays: dict[str, str]
    own: threading.local = field(default_factory=threading.local)
    spare: list[Instance] = field(default_factory=list)
    lock: threading.RLock = field(default_factory=threading.RLock)

    def __reduce__(self) -> tuple[Any, ...]:
        """Read anew by another process."""
        return _read, (self.path, Path(self.path).stat().st_mtime_ns)

    def whole(self, names: Iterable[str]) -> dict[str, None]:
        """These variables, and the elements that stand in arrays with them, in the order of the arrays."""
        there = {n: [e for e, array in self.arrays.items() if array == self.arrays.get(n)] or [n] for n in names}
        return dict.fromkeys(e for elements in there.values() for e in elements)

    def references(self, names: Iterable[str]) -> list[int]:
        """Value references of these variables, one for each array."""
        return list({self.arrays.get(name, name): self.variables[name].valueReference for name in names}.values())

    def of(self, *causalities: str) -> dict[str, Any]:
        """Its real variables of these causalities."""
        return {name: v for name, v in self.variables.items() if v.causality in causalities}

    @property
    def inputs(self) -> dict[str, Any]:
        """Its real inputs that may change at any time."""
        return {name: v for name, v in self.of("input").items() if v.variability in (None, "continuous")}

    @property
    def parameters(self) -> dict[str, Any]:
        """Its real parameters that may be set."""
        known = {**self.of("parameter"), **{n: v for n, v in self.variables.items() if v.variability == "tunable"}}
        return {n: v for n, v in known.items() if v.start is not None and v.causality != "calculatedParameter"}

    @property
    def signs(self) -> int:
        """Event indicators."""
        return int(self.description.numberOfEventIndicators or 0)

    @property
    def switches(self) -> bool:
        """Whether something in it may switch, or it has to be told of each step."""
        told = bool(self.description.modelExchange.needsCompletedIntegratorStep)
        return self.signs > 0 or told or self.instance().next_s < math.inf

    @property
    def threes(self) -> bool:
        """Whether it is of FMI 3.0."""
        return str(self.description.fmiVersion).startswith("3")

    @property
    def once(self) -> bool:
        """Whether a process may have one instance alone."""
        return bool(self.description.modelExchange.canBeInstantiatedOnlyOncePerProcess)

    def alone(self) -> AbstractContextManager[object]:
        """Within it, no other thread uses this thread's instance: they wait where all share one."""
        return self.lock if self.once else nullcontext()

    def instance(self) -> Instance:
        """An instance of this thread, that of one that has ended or a new one; where all share one, see :meth:`alone`.

        A library may keep nothing apart that two threads change.
        """
        with self.lock:
            if self.once:
                self.spare[:] = self.spare or [Instance(self)]
                return self.spare[0]
            if not hasattr(self.own, "lent"):
                self.own.lent = Lent(self.spare.pop() if self.spare else Instance(self), self.spare)
            found: Instance = self.own.lent.instance
            return found


class Lent:
    """An instance that a thread has; it is spare when that ends."""

    def __init__(self, instance: Instance, spare: list[Instance]) -> None:
        self.instance, self._spare = instance, spare

    def __del__(self) -> None:
        self._spare.append(self.instance)


def alone(function: Callable[..., R]) -> Callable[..., R]:
    """Have a function of a model use its instance alone."""

    @functools.wraps(function)
    def held(model: Model, *arguments: Any) -> R:
        with model.alone():
            return function(model, *arguments)

    return held


def model_of(config: RigConfig) -> Model:
    """A rig's FMU.

    Raises
    ------
    UserError : no such file, no FMU, none for Model Exchange, for another platform, without states; FMPy is missing.
    """
    file = Path(config.model)
    if not file.is_file():
        raise UserError("rig.model", config.model, "no such file; a path from the rig's file on")
    return _read(config.model, file.stat().st_mtime_ns)


@functools.lru_cache(maxsize=16)
def _read(path: str, stamp: int) -> Model:
    try:
        import fmpy
    except ImportError:
        raise UserError("rig.model", path, "needs FMPy: pip install 'dtbacklash[fmu]'") from None
    folder = tempfile.TemporaryDirectory()
    try:
        described = fmpy.read_model_description(path, validate=False)
        fmpy.extract(path, folder.name)
    except Exception as error:  # FMPy has no class of its own for what is wrong in a file
        raise UserError("rig.model", path, f"is no FMU: {' '.join(str(error).split())}") from error
    if described.fmiVersion not in ("2.0", "3.0"):
        raise UserError("rig.model", path, f"is FMI {described.fmiVersion}; FMI 2.0 and 3.0 are read")
    if described.modelExchange is None:
        allowed = "is for Co-Simulation only: it hides its states, and a diagnosis has to set them; export it for Model"
        raise UserError("rig.model", path, f"{allowed} Exchange")
    there = fmpy.supported_platforms(path)
    if fmpy.platform not in there:
        raise UserError("rig.model", path, f"is for {', '.join(there) or 'no platform'}; this one is {fmpy.platform}")
    split = {v.name: _elements(v) for v in described.modelVariables if v.type in ("Real", "Float64")}
    real = {e.name: e for elements in split.values() for e in elements}
    arrays = {e.name: array for array, elements in split.items() for e in elements if e.name != array}
    named = [u.variable.derivative.name if u.variable.derivative else "" for u in described.derivatives]
    if not named or not set(named) <= split.keys():
        raise UserError("rig.model", path, "has no continuous states that could be set")
    return Model(path, folder, described, [e.name for name in named for e in split[name]], real, arrays)


def _elements(variable: Any) -> list[Any]:
    """A variable, or those of its array: ``damping[1]``, ``A[2,1]``, each with its own start value.

    Some tools leave out the dimensions of a vector: it has several start values.
    """
    starts = str(variable.start).split() if variable.start is not None else []
    shape = variable.shape if variable.dimensions else (len(starts),) if len(starts) > 1 else ()
    if not shape:
        return [variable]
    found = []
    for k, index in enumerate(np.ndindex(*shape)):
        element = copy.copy(variable)
        element.name = f"{variable.name}[{','.join(str(i + 1) for i in index)}]"
        element.start = starts[k if len(starts) > 1 else 0] if starts else None
        found.append(element)
    return found


class Instance:
    """An FMU that runs. fmu : FMPy's. said : its library's last text, if any. next_s : when its clock strikes first."""

    def __init__(self, model: Model) -> None:
        from fmpy.simulation import instantiate_fmu

        said: list[str] = []
        self.model, self.said, self.next_s, self._begun = model, said, math.inf, False
        self.threes = model.threes

        def log(*arguments: Any) -> None:  # without the instance, which would never be freed
            text = arguments[-1]
            said[:] = [text.decode(errors="replace") if isinstance(text, bytes) else str(text)]

        try:
            with LOADING:  # FMPy goes to the library's folder and back
                self.fmu = instantiate_fmu(model.folder.name, model.description, "ModelExchange", logger=log)
        except Exception as error:
            raise UserError("rig.model", model.path, f"does not load: {' '.join(str(error).split())}") from error
        weakref.finalize(self, _free, self.fmu)

    def begin(self, values: Mapping[str, float]) -> Floats:
        """(states,) its first state with these parameters, ready for continuous time.

        Raises
        ------
        UserError : it does not take a value, or does not begin.
        """
        fmu, title = self.fmu, ""
        self.said.clear()
        try:
            if self._begun:
                fmu.reset()
            self._begun = True
            for title, value in values.items():
                self._set_one(title, value)
            title = ""
            if self.threes:
                fmu.enterInitializationMode()
            else:
                fmu.setupExperiment()
                fmu.enterInitializationMode()
            fmu.exitInitializationMode()
            self._decide()
            fmu.enterContinuousTimeMode()
            x = (self._doubles * len(self.model.states))()
            fmu.getContinuousStates(x, len(x))
        except Exception as error:
            key, given = (f"rig.tolerances.{title}", f"{values[title]:g}") if title else ("rig.model", self.model.path)
            raise UserError(key, given, f"the FMU does not begin with it: {self._why(error)}") from error
        return np.array(x)

    def visit(self, x: Floats) -> None:
        """Put a state, and let what switches there switch.

        Raises
        ------
        UserError : it refuses that.
        """
        try:
            self.fmu.setContinuousStates((self._doubles * len(x))(*x), len(x))
            if self.model.signs:
                self.fmu.enterEventMode()
                self._decide()
                self.fmu.enterContinuousTimeMode()
        except Exception as error:
            raise UserError("rig.model", self.model.path, f"the FMU refuses a state: {self._why(error)}") from error

    def _decide(self) -> None:
        """Let its discrete states find each other, as at each event."""
        for _ in range(DECISIONS):
            again, *_, struck, when = self.fmu.updateDiscreteStates() if self.threes else self.fmu.newDiscreteStates()
            if not again:
                self.next_s = float(when) if struck else math.inf
                return
        raise ValueError(f"its discrete states do not settle in {DECISIONS} turns")

    def _why(self, error: Exception) -> str:
        """What its library said of an error, else the error itself."""
        return " ".join("".join(self.said or [str(error)]).split())

    @property
    def _doubles(self) -> Any:
        from ctypes import c_double

        return c_double

    def _set(self, references: Sequence[int], values: Sequence[float]) -> None:
        (self.fmu.setFloat64 if self.threes else self.fmu.setReal)(references, values)

    def _set_one(self, title: str, value: float) -> None:
        """Set a number; of an array, the others stay."""
        whole, references = list(self.model.whole([title])), self.model.references([title])
        numbers = self.fmu.getFloat64(references, len(whole)) if title in self.model.arrays else [value]
        numbers[whole.index(title)] = value
        self._set(references, numbers)

    def address(self, name: str) -> int:
        """Of a function of its library; ``name`` without fmi2 or fmi3."""
        import ctypes

        function = getattr(self.fmu.dll, f"fmi{3 if self.threes else 2}{name}")
        return int(ctypes.cast(function, ctypes.c_void_p).value or 0)

    def signs(self) -> Floats:
        """(indicators,) what changes its sign at an event, as it is."""
        found = (self._doubles * self.model.signs)()
        if len(found):
            self.fmu.getEventIndicators(found, len(found))
        return np.array(found)

    def rates(self, x: Floats, inputs: Mapping[str, float]) -> Floats:
        """(states,) derivatives at states and inputs, at the time 0.

        Raises
        ------
        UserError : it refuses them, or one is not finite.
        """
        self.said.clear()
        given, found = (self._doubles * len(x))(*x), (self._doubles * len(x))()
        try:
            self._set(self.model.references(inputs), list(inputs.values()))
            self.fmu.setTime(0.0)
            self.fmu.setContinuousStates(given, len(x))
            (self.fmu.getContinuousStateDerivatives if self.threes else self.fmu.getDerivatives)(found, len(x))
        except Exception as error:
            allowed = f"the FMU refuses its derivatives where it begins: {self._why(error)}"
            raise UserError("rig.model", self.model.path, allowed) from error
        rate = np.array(found)
        for state, size in zip(self.model.states, rate, strict=True):
            if not math.isfinite(size):
                allowed = f"the derivative of {state} is {size:g} where it begins, or close to it"
                raise UserError("rig.model", self.model.path, allowed)
        return rate


def _free(fmu: Any) -> None:
    """Give back what a library took; it may say no."""
    with suppress(Exception):  # no lock: the collector may come where one is held
        fmu.freeInstance()
