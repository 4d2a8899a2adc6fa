"""Errors of the nominal, recalibrated, extended and modelled rig, predicted and simulated freely; what is explained."""

import math

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.parameters import apply, taken_out
from dtbacklash.diagnosis.explain.accepted_error import Enough
from dtbacklash.diagnosis.explain.differences import causes_in
from dtbacklash.diagnosis.plot_data import Explained, FitTable, FreeRunning, Left, ModelErrors, RecordingUsed
from dtbacklash.physics.element_kinds import AXES
from dtbacklash.physics.rig import Rig

Passes = list[Floats] | None


class ErrorTables:
    """Every model's errors on all records, predicted at one set of gains (``compared``) and freely (``free``).

    Where each recording is left out in turn these are those of the rig without it, and ``fitted`` those of the rig of
    all.
    """

    def __init__(self, c: Conclusion) -> None:
        self._c, self._seen = c, c.seen
        recalibrated = c.search.nothing.rig if c.model.keys else c.model.rig
        rigs: list[Rig] = [c.search.segments.nominal, recalibrated, c.model.rig]
        if c.modelled is not None:
            rigs.append(c.modelled.rig)
        self.fitted: list[Passes] = [c.seen.errors(rig) for rig in rigs]
        self.fitted_free: list[Passes] = [c.seen.free(rig) for rig in rigs]
        self.compared, self.free = self.fitted, self.fitted_free
        if c.left_out[0]:  # what judges a recording has not seen it
            others = [{}, *c.left_out, {}]
            self.compared, self.free = (
                [of(rig, without) for rig, without in zip(rigs, others, strict=False)]
                for of in (c.seen.errors, c.seen.free)
            )
        self.spread, self.floor = c.seen.spread(), c.seen.floor()

    def fit(self) -> FitTable:
        """As the models are compared."""
        floor = float(np.sqrt(np.mean([(self.floor[c] / self.spread[c]) ** 2 for c in self.floor])))
        parts = self._errors(self.fitted, "train"), self._errors(self.compared, "held")
        return FitTable("nrmse", self._seen.channels, parts[0], parts[1], floor)

    def free_running(self) -> FreeRunning:
        """With nothing measured coming to help."""
        parts = self._errors(self.fitted_free, "train"), self._errors(self.free, "held")
        return FreeRunning(*parts, self._seen.window_s)

    def _errors(self, passes: list[Passes], part: str, numbers: tuple[int, ...] | None = None) -> ModelErrors:
        """Normalised rms over the channels, of each model; None where one does not stay finite."""
        found = []
        for errors in passes:
            squares = self._seen.mean_squares(errors, part, numbers)
            each = [squares[c] / self.spread[c] ** 2 for c in squares]
            value = float(np.sqrt(np.mean(each))) if each else np.inf
            found.append(value if np.isfinite(value) else None)
        return ModelErrors(*found)

    def recordings(self) -> tuple[RecordingUsed, ...]:
        """What was used of each of several recordings, and the held-out errors there; empty for one."""
        numbers = sorted({s.record.recording for s in self._seen.stretches})
        if len(numbers) < 2:
            return ()
        found = []
        for number in numbers:
            own = [s.record for s in self._seen.stretches if s.record.recording == number]
            judged = sum(int(r.held.sum()) for r in own)
            errors = self._errors(self.compared[:3], "held", (number,)) if judged else None
            fitted = sum(int(r.train.sum()) for r in own)
            samples = sum(r.samples for r in own)
            zeros: dict[str, dict[str, float | str]] = {
                s.name: {"value": s.zero, "unit": s.unit}
                for s in self._c.model.rig.of(number).sensors.values() if s.relative and fitted and s.name in own[0].y
            }  # fmt: skip
            name, step = str(number + 1), own[0].sample_time_s
            found.append(RecordingUsed(name, samples, step, fitted, judged, errors, zeros, causes_in(self._c, number)))
        return tuple(found)

    def in_floors(self) -> dict[str, ModelErrors]:
        """Channel -> held-out rms error of the three rigs, in units of what the last would leave were it true."""
        squares = [self._seen.mean_squares(e, "held") for e in self.compared[:3]]
        found = {}
        for c, floor in self.floor.items():
            found[c] = ModelErrors(*(float(np.sqrt(s[c])) / floor if c in s else None for s in squares))
        return found

    def explained(self, enough: Enough) -> Explained:
        """What the extended rig explains of what judges. enough : channels that are not in it do not count."""
        nominal, sensors = self._c.search.segments.nominal, self._c.search.segments.nominal.sensors
        squares = self._seen.mean_squares(self.compared[2], "held")
        left = {
            c: Left(rms, sensors[c].unit, rms / self.spread[c], rms / self.floor[c])
            for c, rms in ((c, float(np.sqrt(v))) for c, v in squares.items())
        }
        asked = [
            (left[c].of_motion if share else left[c].rms, most) for c, (most, share) in enough.items() if c in left
        ]
        met = all(rest <= most for rest, most in asked) if asked else None
        table, free = self.fit(), self.free_running()
        beats = any(e is not None and e < 1.0 for e in (table.held_out.extended, free.held_out.extended))
        floor = table.noise_floor
        shares = [_share(t.held_out, t.held_out.extended, floor) for t in (free, table)]
        modelled = None
        if self._c.modelled is not None:
            both = [_share(t.held_out, t.held_out.modelled, floor) for t in (free, table)]
            modelled = both[0], both[1]
        after = self._c.unknown(self._c.last)
        unknown = {
            body: {"before": before, "after": after.get(body, 0.0), "force": force, "unit": unit}
            for (body, before), force, unit in zip(
                self._c.unknown(self._c.search.nothing).items(), self._c.search.segments.predictors[0].force.tolist(),
                [_effort_unit(nominal, b) for b in self._c.search.segments.linear.bodies], strict=True,
            )
        }  # fmt: skip
        return Explained(shares[0], shares[1], left, met, beats, modelled, unknown, self._causes(table, free))

    def _causes(self, table: FitTable, free: FreeRunning) -> dict[str, float]:
        """Each cause's share of the mismatch: by what its absence alone adds to the errors; nothing is fitted anew.

        Simulated freely, unless a constant would do as well there; else as compared.
        """
        c, last = self._c, "modelled" if self._c.modelled is not None else "extended"
        alone = (getattr(free.held_out, last) or math.inf) < 1.0
        passes, errors = (self.fitted_free, free) if alone else (self.fitted, table)
        explained = _share(errors.held_out, getattr(errors.held_out, last), table.noise_floor)
        least, seen = self._mean_square(passes[-1]), self._seen.free if alone else self._seen.errors
        rigs = {".".join(key): taken_out(c.last.rig, key) for key in c.last.keys}
        titles = {c.label(f.shared_title, f.recording): f for f in c.values.free}
        rigs |= {title: apply(c.last.rig, [f], np.zeros(1)) for title, f in titles.items() if title in c.moved}
        added = {name: min(self._mean_square(seen(rig)) - least, 1e12) for name, rig in rigs.items()}
        total = sum(max(more, 0.0) for more in added.values())
        if explained is None or explained <= 0.0 or not total > 0.0:
            return {}
        return {name: explained * max(more, 0.0) / total for name, more in added.items()}

    def _mean_square(self, errors: Passes) -> float:
        """Of what judges, over the channels in units of their variances; infinite where nothing stays finite."""
        squares = self._seen.mean_squares(errors, "held")
        return float(np.mean([squares[c] / self.spread[c] ** 2 for c in squares])) if squares else np.inf


def _effort_unit(rig: Rig, body: str) -> str:
    return AXES[rig.elements[body].trait.axis][2] if body in rig.elements else "N"


def _share(errors: ModelErrors, error: float | None, floor: float) -> float | None:
    """Share of the nominal rig's mean square error above the floor that a rig with this error does not make."""
    if errors.nominal is None or error is None or errors.nominal <= floor:
        return None
    before, after = errors.nominal**2 - floor**2, max(error**2 - floor**2, 0.0)
    return 1.0 - after / before
