"""What the figures of a diagnosis show: the signals, the laws, and where the evidence lies."""

import numpy as np

from dtbacklash.arrays import Floats
from dtbacklash.diagnosis.conclusion import Conclusion
from dtbacklash.diagnosis.engine.candidates import Proposal
from dtbacklash.diagnosis.engine.parameters import Key
from dtbacklash.diagnosis.explain.errors import ErrorTables, Passes
from dtbacklash.diagnosis.findings import Modelled
from dtbacklash.diagnosis.labels import place_in_words
from dtbacklash.diagnosis.plot_data import Curve, LawShown, PlotData
from dtbacklash.physics.catalogue import find
from dtbacklash.physics.drawing import POINTS, drawing_of, effort_over, law_curve
from dtbacklash.physics.effects.table import KNOTS, SHAPES
from dtbacklash.recording.channels import filled

EFFORTS = {"N m": "missing torque", "N": "missing force", "V": "missing voltage", "m": "missing displacement"}
#: the loop of a recording's own stroke: this quantile of the state about its middle
STROKE = 0.98


def shown(c: Conclusion, tables: ErrorTables, causes: dict[str, float]) -> PlotData:
    """Everything that is drawn. causes : what each explains."""
    laws = [law for key in c.model.keys if (law := _law(c, key)) is not None]
    rest = next((p for p in c.judged.rest if p.gain > c.search.rules.min_gain * c.search.segments.count), None)
    if c.modelled is not None:
        laws.append(_as_modelled(c.modelled))
    elif rest is not None and not c.explains:
        laws.append(_recovered(c, rest))
    curves = _curves(c, tables, tables.compared[0], tables.compared[-1])
    ends = tables.free[0], tables.free[-1]
    alone = [] if any(end is None for end in ends) else _curves(c, tables, *ends)
    return PlotData(_shares(c, causes), tuple(curves), tuple(laws), tables.in_floors(), tuple(alone))


def _shares(c: Conclusion, causes: dict[str, float]) -> dict[str, float]:
    """Place -> its share of what the names explain: of the mismatch, or of what was fitted where that is not known."""
    weights: dict[str, float] = {}
    gains = {".".join(key): gain for key, gain in c.judged.explains.items()}
    for name, weight in (causes or gains).items():
        place, _, effect = name.rpartition(".")
        if (place, effect) in c.last.keys:
            weights[place] = weights.get(place, 0.0) + weight
    total = sum(weights.values())
    return {place: weight / total for place, weight in weights.items()} if total > 0.0 else {}


def _curves(c: Conclusion, tables: ErrorTables, nominal: Passes, extended: Passes) -> list[Curve]:
    """Measured, and what two rigs say, by their errors: a channel and a recording each."""
    found: dict[tuple[str, int], list[tuple[np.ndarray, ...]]] = {}
    for k, s in enumerate(c.seen.stretches):
        for j, channel in enumerate(s.predictor.readings.channels):
            y = s.measured[:, j]
            there = [filled(y - e[k][:, j]) if e is not None else np.full(len(y), np.nan) for e in (nominal, extended)]
            found.setdefault((channel, s.record.recording), []).append((s.t_s, filled(y), *there, s.held & ~s.train))
    curves = []
    for (channel, number), parts in found.items():
        t_s, y, first, last, held = (np.concatenate(column) for column in zip(*parts, strict=True))
        judged = np.flatnonzero(held)
        curves.append(Curve(
            channel if number == 0 else f"{channel} ({c.named(number)})",
            c.search.segments.nominal.sensors[channel].unit, t_s, y, first, last,
            float(t_s[judged[0]]) if judged.size else None, tables.floor[channel],
        ))  # fmt: skip
    return curves


def _law(c: Conclusion, key: Key) -> LawShown | None:
    """The law of a name beside the table that the recording asks for without it; None where it has no one state."""
    place, name = key
    rig = c.model.rig
    entry, values = find(rig.kind_at(place), name, place), rig.effects[place][name]
    drawing = drawing_of(entry)
    if drawing is None or entry.is_table:
        return None
    over = _state(c, place, drawing.state)
    if over is None:
        return None
    states, unit = over
    table = next(
        (p for p in c.judged.tables.get(key, ())
         if SHAPES[p.keys[0][1]].over == drawing.state and SHAPES[p.keys[0][1]].times == drawing.times), None,
    )  # fmt: skip
    if drawing.shape == "wave":
        reach = 0.0, 2.0 * np.pi / (values[drawing.wave] if drawing.wave else 1.0)
        table = None
    elif drawing.shape == "loop":
        table = None
        assert drawing.width is not None
        half = drawing.stroke * drawing.width(values) if drawing.stroke else float(
            np.quantile(np.abs(states - np.median(states)), STROKE)
        )  # fmt: skip
        reach = -half, half
    else:
        reach = float(np.quantile(states, 0.002)), float(np.quantile(states, 0.998))
    if not reach[1] > reach[0]:
        return None
    law = law_curve(drawing, values, rig.elements[place].values, reach)
    effort_unit = drawing.effort_unit or entry.size.unit
    points = _points(table, drawing.state == "command") if table is not None else (np.empty(0),) * 3
    label = "time" if drawing.state == "time" else f"{drawing.state} of {place_in_words(place)}"
    share = float("nan")
    if table is not None:
        share = 1.0 - min(c.judged.adds.get(key, 0.0), 1.0)
        effort_unit = drawing.effort_unit or table.parts[0][0].effect.size.unit
    return LawShown(
        place, name, label, drawing.effort_label or EFFORTS.get(effort_unit, "missing effort"), unit, effort_unit,
        *law, *points, share,
    )  # fmt: skip


def _state(c: Conclusion, place: str, state: str) -> tuple[Floats, str] | None:
    """(N,) a state of a place as predicted, and its unit."""
    motion, rig = c.search.motion, c.model.rig
    if state == "time":
        return motion.time, "s"
    states = motion.states(place)
    if state == "angle" and (rotor := rig.motor_rotor()) is not None and rotor.name in motion.position:
        return motion.position[rotor.name], "rad"
    if state not in states:
        body = next(iter(motion.position), None)
        drive = rig.elements[place].neighbours.get("drives", body) if place in rig.elements else body
        states = motion.states(drive) if drive in motion.position else {}
    if state not in states:
        return None
    kinds = ("rotor", "turning_joint", "shaft", "gearbox", "gear", "motor_circuit")
    turning = "rad" if rig.elements[place].kind in kinds else "m"
    return states[state], {"command": rig.command_unit, "speed": f"{turning}/s", "stretch rate": f"{turning}/s"}.get(
        state, turning
    )


def _points(p: Proposal, over_command: bool) -> tuple[Floats, Floats, Floats]:
    """State, effort and standard error of a table's values; of the amplifier, output over input."""
    ((h, heights),) = p.parts
    assert heights is not None
    assert p.errors is not None
    knots = np.array([h.values[f"x{k + 1}"] for k in range(KNOTS)])
    return knots, heights + knots * over_command, p.errors


def _recovered(c: Conclusion, p: Proposal) -> LawShown:
    """The force that the recording still needs, against the state that explains most of it."""
    ((h, _),) = p.parts
    shape = SHAPES[h.effect.name]
    state, effort, error = _points(p, False)
    unit = h.effect.size.unit
    return LawShown(
        h.place, "", f"{shape.over} of {place_in_words(h.place)}",
        f"missing effort by {shape.times}" if shape.times else EFFORTS.get(unit, "missing effort"),
        h.effect.parameters[KNOTS].unit, unit, state=state, recovered=effort, error=error,
    )  # fmt: skip


def _as_modelled(modelled: Modelled) -> LawShown:
    """The table or formula of what no name explains, with the table's values as points."""
    rig, place = modelled.rig, modelled.location
    entry, values = find(rig.kind_at(place), modelled.effect, place), rig.effects[place][modelled.effect]
    state, effort, error = (np.array(column) for column in zip(*modelled.points, strict=True))
    missing = EFFORTS.get(modelled.unit, "missing effort")
    grid = np.linspace(state[0], state[-1], POINTS)
    curve = effort_over(entry, values, modelled.state, modelled.times, grid)
    if modelled.state == "command":  # drawn as output over input
        curve, effort = curve + grid, effort + state
    return LawShown(
        place, modelled.effect, f"{modelled.state} of {place_in_words(place)}",
        f"missing effort by {modelled.times}" if modelled.times else missing, modelled.state_unit, modelled.unit,
        grid, curve, state, effort, error,
    )  # fmt: skip
