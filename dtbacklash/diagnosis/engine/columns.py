"""Columns: what whitened innovations change by when a small amount of a hypothesis is put into a rig."""

from collections.abc import Sequence

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.engine.efforts import SMALL, Entry, efforts
from dtbacklash.diagnosis.engine.filter import answers
from dtbacklash.diagnosis.engine.hypotheses import Hypothesis
from dtbacklash.diagnosis.engine.motion import Motion
from dtbacklash.diagnosis.engine.predictor import Gains
from dtbacklash.diagnosis.engine.segments import Segments
from dtbacklash.physics.effects import slots
from dtbacklash.physics.rig import Rig


class ColumnMaker:
    """Makes the columns around a rig, at given gains. rows : its innovations (rows,) on these segments."""

    def __init__(self, segments: Segments, rig: Rig, gains: Sequence[Gains], motion: Motion, rows: Floats) -> None:
        self.segments, self.rig, self.gains, self.motion = segments, rig, gains, motion
        self.plants = [p.simulated.linear(rig) for p in segments.predictors]
        self._rows = rows

    def columns(self, h: Hypothesis) -> list[Floats] | None:
        """The columns of a hypothesis; None where the rig cannot have it, or it shows nowhere."""
        known = efforts(h, self.rig, self.motion)
        if known is not None:
            found = list(self.answered(*known))
        elif h.effect.is_table:
            return None
        else:
            simulated = self.simulated(h)
            if simulated is None:
                return None
            found = simulated
        with np.errstate(over="ignore"):
            # of what it begins with: a column is per unit of a size, whose number may be large
            begun = 1.0 if h.as_it_is or h.effect.is_table else h.values[h.effect.size.name]
            squares = [float(c @ c) * begun**2 for c in found]
        # a table's outer value may lie where the motion never is
        enough = any(s > 1e-12 for s in squares) if h.effect.is_table else all(s > 1e-12 for s in squares)
        return found if enough and np.isfinite(squares).all() else None

    def simulated(self, h: Hypothesis) -> list[Floats] | None:
        """The same by simulation with a small amount of it, or with it as it is."""
        found, size = [], h.effect.size.name
        for phase in (0.0, 0.5 * np.pi) if h.angle else (None,):
            values, per = dict(h.values) if phase is None else {**h.values, h.angle: phase}, 1.0
            if not h.as_it_is:
                values[size] = per = SMALL * values[size]
            rows = self.segments.residuals(self.rig.with_effect(*h.key, values), self.gains)
            if rows is None or not per:
                return None
            found.append((rows - self._rows) / per)
        return found

    def answered(self, F: Floats, entry: Entry) -> Floats:
        """(J, rows) of efforts (J, N) by the linear plant."""
        found, first = [], 0
        for p, g, L in zip(self.segments.predictors, self.gains, self.plants, strict=True):
            r = p.readings
            n = len(r.u)
            b, c = np.zeros(len(L.states)), np.zeros(len(r.channels))
            here = F[:, first : first + n]
            first += n
            if entry.channel:
                if entry.channel not in r.channels:
                    found.append(np.zeros((len(F), r.y.size)))
                    continue
                c[r.channels.index(entry.channel)] = 1.0
            if entry.drive:
                b, c = L.drives[entry.drive]
            if entry.voltage:
                b, c = L.volt[1].copy(), L.volt_at_once.copy()
            for body, factor in entry.bodies.items():
                at = L.force(L.bodies.index(body))
                b, c = b + factor * at[0], c + factor * at[1]
            found.append(answers(
                np.ascontiguousarray(L.A[1]), np.ascontiguousarray(L.C[1]), np.ascontiguousarray(g.K[1]), g.W[1],
                r.which(g.opening, r.y), np.ascontiguousarray(here), b, c, ~r.there,
                bool(entry.channel),
            ))  # fmt: skip
        return np.concatenate(found, axis=1)


def by_delay(asked: Sequence[Hypothesis]) -> list[list[Hypothesis]]:
    """Hypotheses together that differ by how late a signal is, least first; each other for itself.

    A small play or friction may explain nothing where a large one is there.
    """
    series: dict[object, list[Hypothesis]] = {}
    for h in asked:
        size = h.effect.size
        others = tuple(value for name, value in h.values.items() if name != size.name)
        late = h.as_it_is and isinstance(h.effect.slot, (slots.Late, slots.Filter))
        series.setdefault((h.key, others) if late else h, []).append(h)
    return [
        sorted(those, key=lambda h: h.values[h.effect.size.name], reverse=those[0].effect.size.neutral != 0.0)
        for those in series.values()
    ]
