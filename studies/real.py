"""The public recordings diagnosed: the tables of ``real-recordings.md``, none of whose figures is typed by hand.

``python -m studies real [FOLDER [NAME ...]]`` diagnoses each public recording that is at hand, which takes
minutes, and writes ``real/<name>.json`` and the tables between two lines of ``real-recordings.md`` into a folder
(default: ``docs``); with names only these are diagnosed anew.
"""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator, default_rng

from dtbacklash.errors import UserError
from dtbacklash.files import read_json, write_json, write_text
from dtbacklash.physics.rig import Rig
from dtbacklash.report.components.intervals import interval
from dtbacklash.report.components.markdown import table
from dtbacklash.report.components.numbers import number

PAGE, DATA = "real-recordings.md", "real"
BEGIN = "<!-- diagnoses: begin, made by python -m studies real docs -->"
END = "<!-- diagnoses: end -->"
MODELS = ("nominal", "recalibrated", "extended")
#: errors beyond so many times the signal are not given in percent
MANY_TIMES = 10.0
#: and beyond so many times a rig has run away
RAN_AWAY = 1e6
#: rigs that are drawn for the interval of a prediction
DRAWS = 60
#: of a prediction the first samples do not count, as the benchmarks' loader has it
FIRST = 50


@dataclass(frozen=True)
class Case:
    """One diagnosis of a public recording.

    Attributes
    ----------
    name : of its data. title : in the tables. recording, validation : as ``dtb diagnose`` takes them.
    predicts : a part that the diagnosis never sees -> what is published of its error.
    known : ``location.effect.parameter`` -> what is known of it otherwise, with (pub) where the publication says so and
        (here) where it was computed on the same file by hand.
    """

    name: str
    title: str
    recording: str
    validation: str = ""
    known: Mapping[str, str] = field(default_factory=dict)
    predicts: Mapping[str, str] = field(default_factory=dict)

    @property
    def command(self) -> str:
        """The command that makes the same diagnosis."""
        judged = [f"validation={self.validation}"] if self.validation else []
        return shlex.join(["dtb", "diagnose", f"recording={self.recording}", *judged, f"out={self.name}"])


CASES = (
    Case("emps", "EMPS", "emps", known={
        "carriage.viscous_friction.coefficient": "203.5 N s/m (pub)",
        "carriage.coulomb_friction.force": "20.4 N (pub)",
        "carriage.asymmetric_friction.viscous_difference": "-36.85 N s/m (pub)",
    }),
    Case("emps_half", "EMPS, the first half", "emps:first", predicts={"emps:second": ""}),
    Case("silverbox", "Silverbox", "silverbox", predicts={
        "silverbox:multisine": "GRU 1.49 mV, RNN 1.64 mV (pub)", "silverbox:arrow": "GRU 2.80 mV, RNN 4.88 mV (pub)",
    }),
    Case("brfd", "BRFD, 0.5 Hz, 1 in", "brfd", known={"joint.backlash.lost_motion": "5.0 to 5.8 mm (here)"}),
    Case("brfd_other", "BRFD, judged on 0.25 Hz, 0.5 in", "brfd", "dataset-2_0.25Hz_30lb_0.5in.json",
         known={"joint.backlash.lost_motion": "5.0 to 5.8 mm (here)"}),
    Case("disk", "unbalanced disk", "disk", known={
        "disk.gravity.torque": "33.3 mN m (here)", "disk.gravity.phase": "π - 0.034 rad (here)",
        "disk.coulomb_friction.torque": "1.59 mN m (here)", "amplifier.delay.time": "25 ms (here)",
    }),
    Case("anticogging_off", "motor, compensation off", "anticogging:off",
         known={"rotor.cogging.periods": "72, then 18, 12, 144 1/rev (here)"}),
    Case("anticogging_on", "motor, compensation on", "anticogging:on",
         known={"rotor.cogging.periods": "72, then 18, 12, 144 1/rev (here)"}),
)  # fmt: skip


def diagnosed(case: Case) -> dict[str, Any]:
    """Diagnose one recording; returns what the page says of it.

    Raises
    ------
    UserError : the recording is not here, or has a fault of wiring, a sensor or the sampling.
    """
    from dtbacklash import diagnose, load_rig
    from dtbacklash.recording import mapping_of, read_pair, read_recording

    mapping = mapping_of(case.recording)
    assert mapping is not None
    assert mapping.rig is not None
    rig = load_rig(mapping.rig)
    begin = time.perf_counter()
    if case.validation:
        fitted, judged = read_pair(case.recording, case.validation, rig=rig)
    else:
        fitted, judged = read_recording(case.recording, rig=rig), None
    found = diagnose(fitted, rig, judged)
    seconds = time.perf_counter() - begin
    work, said = found.diagnosis.work, found.to_json()
    if work is None:
        raise UserError("recording", case.recording, f"cannot be diagnosed: {found.diagnosis.fault}")
    share = work.judged / (work.fitted + work.judged)
    sizes = {name: (float(fitted.channels[name].std()), fitted.units[name]) for name in said["fit"]["channels"]}
    parts = {part: predicted(found.rig, said, part, work.smooth) for part in case.predicts}
    return summary(said, sizes, share) | {"samples": fitted.samples, "seconds": round(seconds, 1), "predicted": parts}


def predicted(rig: Rig, said: dict[str, Any], part: str, smooth: bool) -> dict[str, Any]:
    """The error of the extended rig on a part that it has never seen, by the command alone.

    Its interval is that of rigs whose parameters are drawn from their intervals, each on its own: what they have in
    common is not known here, so that it is rather too wide. smooth : as the diagnosis read the command.
    """
    from dtbacklash.diagnosis import records_of
    from dtbacklash.diagnosis.engine.sensor_zeros import zeroed
    from dtbacklash.diagnosis.predictions import segments_of
    from dtbacklash.diagnosis.records import held_equivalent
    from dtbacklash.recording import read_recording

    records = records_of(read_recording(part, rig=rig), rig, True, False)
    (channel,) = records[0].y
    records = [replace(r, u=held_equivalent(r.u)) if smooth else r for r in records]
    segments = segments_of(rig, records, [1] * len(records))
    rig = zeroed(segments, rig)  # a sensor's zero is each recording's own

    def error(of: Rig) -> float:
        squares = []
        for p in segments.predictors:
            gains = p.gains(of, p.first_noise_levels())
            gains.K[:, FIRST:] = 0.0  # the first samples show the first state; from there on nothing comes to help
            squares.append(p.run(of, gains).D[FIRST:] ** 2)
        return float(np.sqrt(np.mean(np.concatenate(squares))))

    rng = default_rng(1)
    drawn = [error(_drawn(rig, said, rng)) for _ in range(DRAWS)]
    low, high = (float(end) for end in np.quantile(drawn, (0.025, 0.975)))
    return {"channel": channel, "unit": rig.sensors[channel].unit, "rms": error(rig), "ci95": [low, high]}


def _drawn(rig: Rig, said: dict[str, Any], rng: Generator) -> Rig:
    """The rig with all that was found drawn from its interval."""

    def draw(found: dict[str, Any]) -> float:
        ends = [end for end in found["ci95"] if end is not None]
        width = (ends[1] - ends[0]) / (2.0 * 1.96) if len(ends) == 2 else 0.0
        return float(found["value"] + width * rng.standard_normal())

    for f in said["findings"]:
        law = rig.takes(f["location"])[f["effect"]]
        given = [p for p in law.parameters if p.name in f["parameters"]]  # others do nothing
        within = {p.name: float(np.clip(draw(f["parameters"][p.name]), p.low, p.high)) for p in given}
        rig = rig.with_effect(f["location"], f["effect"], within)
    return rig.with_parameters({n: draw(p) for n, p in said["recalibrated"].items() if n in rig.config.parameters})


def summary(found: dict[str, Any], sizes: Mapping[str, tuple[float, str]], held_share: float) -> dict[str, Any]:
    """What the page needs of a ``diagnosis.json``.

    Parameters
    ----------
    sizes : channel -> standard deviation and SI unit of the recorded signal, by which its errors were divided.
    held_share : share of all samples that judge.
    """
    kept = ("location", "effect", "confidence", "parameters", "also_fits")
    return {
        "verdict": found["verdict"],
        "findings": [{name: f.get(name) for name in kept} for f in found["findings"]],
        "recalibrated": found["recalibrated"],
        "located": {name: found["located"].get(name) for name in ("location", "state")} if found["located"] else None,
        "fit": found["fit"],
        "free_running": found.get("free_running"),
        "sizes": {name: list(size) for name, size in sizes.items()},
        "held_share": held_share,
    }


def make(cases: Sequence[Case], docs: Path, by: Callable[[Case], dict[str, Any]] = diagnosed) -> None:
    """Make the data of some diagnoses, and then the tables of all that there are.

    Raises
    ------
    UserError : a recording is not here, or the page has no place for the tables.
    """
    _around_tables(docs)
    for count, case in enumerate(cases, 1):
        print(f"{count} of {len(cases)}: {case.title}", file=sys.stderr, flush=True)
        write_json(docs / DATA / f"{case.name}.json", by(case))
    # read only now: the page may have been edited while the diagnoses took their minutes
    before, after = _around_tables(docs)
    write_text(docs / PAGE, before + block(docs) + after)


def _around_tables(docs: Path) -> tuple[str, str]:
    """What the page has before and after its tables."""
    text = (docs / PAGE).read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise UserError("docs", docs, f"needs a {PAGE} with the lines {BEGIN} and {END}")
    return text.split(BEGIN)[0], text.split(END)[1]


def block(docs: Path) -> str:
    """What stands between ``BEGIN`` and ``END``, from the data of the diagnoses."""
    there = [(case, read_json(docs / DATA / f"{case.name}.json")) for case in CASES]
    known = [(case, found) for case, found in there if found]
    if not known:
        return f"{BEGIN}\n{END}"
    heads = ("recording", "verdict", "named", "what is left", "samples", "time on busy cores")
    said = [
        [c.title, f"`{f['verdict']}`", _named(f), _left(f), str(f["samples"]), f"{f['seconds']:.0f} s"]
        for c, f in known
    ]
    errors = ("recording", *(f"{model}, held out" for model in MODELS), "noise floor")
    free = ("recording", *(f"{model}, held out" for model in MODELS), "extended, all of it")
    parts = [
        BEGIN, "", "```sh", *(c.command for c, _ in known), "```", "", table(heads, said),
        "The error as it was compared (pulled towards the measurement where the rig would leave it), relative:\n",
        table(errors, ([c.title, *_pulled(f)] for c, f in known)),
        "Free-running: the command in, nothing measured coming to help, from the first sample on:\n",
        table(free, ([c.title, *_free(f)] for c, f in known)),
        "A part that the diagnosis never saw, predicted by the command alone (rms without the first 50 samples, with\n"
        "a 95 % interval over rigs drawn from the intervals below):\n",
        table(("fitted to", "predicted", "extended rig", "published"), (r for c, f in known for r in _predicted(c, f))),
        "What was named, with 95 % intervals, beside what is known of it otherwise:\n",
        table(("recording", "parameter", "found", "known"), (row for c, f in known for row in _values(c, f))), END,
    ]  # fmt: skip
    return "\n".join(parts)


def _named(found: dict[str, Any]) -> str:
    def partly(finding: dict[str, Any]) -> str:
        return f" ({finding['confidence']})" if finding.get("confidence") in ("partial", "one_of") else ""

    return ", ".join(f"{f['effect']} at `{f['location']}`{partly(f)}" for f in found["findings"]) or "nothing"


def _left(found: dict[str, Any]) -> str:
    """Where what nothing explains lies, and of which state it depends most."""
    located = found.get("located")
    if not located:
        return ""
    return f"at `{located['location']}`" + (f", over {located['state']}" if located["state"] else "")


def _share(error: float | None) -> str:
    if error is None or error > RAN_AWAY:
        return "ran away"
    return f"{number(error)} times" if error > MANY_TIMES else f"{number(100.0 * error)} %"


def _pulled(found: dict[str, Any]) -> list[str]:
    fit = found["fit"]
    return [*(_share(fit["held_out"][model]) for model in MODELS), _share(fit["noise_floor"])]


def _free(found: dict[str, Any]) -> list[str]:
    """Rms errors: in the unit of the channel where there is one, else relative."""
    free = found["free_running"] or {part: dict.fromkeys(MODELS) for part in ("train", "held_out")}
    errors = [free["held_out"][model] for model in MODELS]
    parts = (free["train"]["extended"], free["held_out"]["extended"])
    held = found["held_share"]
    errors.append(None if None in parts else math.sqrt((1.0 - held) * parts[0] ** 2 + held * parts[1] ** 2))
    if len(found["sizes"]) > 1:
        return [_share(error) for error in errors]
    size, unit = next(iter(found["sizes"].values()))
    return [
        "ran away" if error is None or error > RAN_AWAY else interval(float(f"{error * size:.3g}"), None, unit)
        for error in errors
    ]


def _predicted(case: Case, found: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    for part, p in found.get("predicted", {}).items():
        yield case.title, f"`{part}`", interval(p["rms"], p["ci95"], p["unit"]), case.predicts[part]


def _values(case: Case, found: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    for f in found["findings"]:
        for name, p in (f["parameters"] or {}).items():
            known = case.known.get(f"{f['location']}.{f['effect']}.{name}", "")
            shown = interval(p["value"], p["ci95"], p["unit"])
            yield case.title, f"{f['effect']} at `{f['location']}`: {name}", shown, known
    for name, p in found["recalibrated"].items():
        shown = interval(p["value"], p["ci95"], p["unit"])
        yield case.title, f"`{name}`, nominal {interval(p['nominal'], None, p['unit'], size=p['value'])}", shown, ""


def main(words: Sequence[str]) -> None:
    """Make the tables in the folder ``words[0]``; of the recordings named after it, or all."""
    docs, names = Path(words[0] if words else "docs"), words[1:]
    unknown = set(names) - {case.name for case in CASES}
    if unknown:
        raise SystemExit(f"no diagnosis {min(unknown)!r}; choose of {', '.join(case.name for case in CASES)}")
    make([case for case in CASES if not names or case.name in names], docs)
    print(docs / PAGE)
