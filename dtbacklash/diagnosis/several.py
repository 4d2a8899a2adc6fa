"""Several recordings that are diagnosed together: which they are called, what they share, which judges."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from dtbacklash.diagnosis.plot_data import RecordingUsed
from dtbacklash.diagnosis.records import Record, records_of
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording
from dtbacklash.recording.validation import check_apart, shared_rows

#: what judges: each in turn, by default from so many on; or the end of each
TURNS, ENDS, TURNS_FROM = "turns", "ends", 3


def source_of(recording: Recording) -> str:
    """The name of a recording and, after a colon, of its part."""
    return f"{recording.name}:{recording.part}" if recording.part else recording.name


def names_of(recordings: Sequence[Recording]) -> list[str]:
    """What each is called: its name, with the folder of its file where two have the same, and else with its number."""
    names = [source_of(r) for r in recordings]
    for longer in (
        [f"{r.source.resolve().parent.name}/{n}" if r.source else n for r, n in zip(recordings, names, strict=True)],
        [f"{n} ({k})" for k, n in enumerate(names, 1)],
    ):
        count = Counter(names)
        names = [other if count[n] > 1 else n for n, other in zip(names, longer, strict=True)]
    return names


@dataclass(frozen=True)
class Several:
    """Recordings, each with its own channels. judges : (recordings,) whether it judges alone, and is not fitted.

    names : of the recordings. turns : whether each is left out in turn, to judge what the others say. notes : on
    channels that not all have.
    """

    recordings: list[Recording]
    judges: list[bool]
    names: list[str]
    turns: bool = False
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, recordings: Sequence[Recording], validation: Sequence[Recording] | str | int | None, rig: Rig,
        hold_out: str | int | None = None,
    ) -> "Several":  # fmt: skip
        """The recordings to fit, then those of ``validation`` that are not among them.

        validation : others; or the name, the file or the number (from 1) of one that is left out to judge. hold_out :
            the same of one; :data:`TURNS`, each in turn, the default from three on; :data:`ENDS`, the end of each.

        Raises
        ------
        UserError : the validation is none of them; all judge; one has no channel of the rig; two are the same.
        """
        fitted = len(recordings)
        names = names_of(recordings)
        judges = [False] * fitted
        key, alone = ("validation", validation) if hold_out in (None, TURNS, ENDS) else ("hold_out", hold_out)
        others = [] if validation is None or isinstance(validation, (str, int)) else list(validation)
        if hold_out is not None and validation is not None:
            raise UserError("hold_out", hold_out, f"says what judges, and so does validation={validation}: give one")
        turns = validation is None and (hold_out == TURNS or (hold_out is None and fitted >= TURNS_FROM))
        if isinstance(alone, (str, int)):
            judges[_number(key, recordings, names, alone)] = True
            if all(judges):
                raise UserError(key, alone, "leaves no recording to fit to")
        recordings = [*recordings, *others]
        names = names_of(recordings)
        judges += [True] * len(others)
        _check_apart(recordings, names, judges)
        return cls(list(recordings), judges, names, turns, _not_in_all(recordings, names, rig))

    def number(self, key: str, wanted: str | int) -> int:
        """Which recording a name, a file or a number from 1 means; UserError, naming the key, where it is none."""
        return _number(key, self.recordings, self.names, wanted)

    @property
    def judging(self) -> str:
        """The names of those that judge alone; empty where each recording judges with its end."""
        return ", ".join(n for n, judges in zip(self.names, self.judges, strict=True) if judges)

    def used(self, records: list[Record], found: Sequence[RecordingUsed]) -> Iterator[RecordingUsed]:
        """What was used of each, with its name; without errors where a diagnosis came to none (``found`` is empty)."""
        known = {int(one.name): one for one in found}
        for number, (recording, name) in enumerate(zip(self.recordings, self.names, strict=True)):
            own = [r for r in records if r.recording == number]
            fitted, judged = (sum(int(getattr(r, part).sum()) for r in own) for part in ("train", "held"))
            bare = RecordingUsed(name, recording.samples, recording.sample_time_s, fitted, judged)
            yield replace(known.get(number + 1, bare), name=name, samples=recording.samples)

    def records(self, rig: Rig, held_out: float) -> list[Record]:
        """The stretches of all: where none judges alone, each gives its last share ``held_out``, or in turn all."""
        ends = not (any(self.judges) or self.turns)
        found = [
            replace(record, name=name)
            for number, (recording, judges, name) in enumerate(
                zip(self.recordings, self.judges, self.names, strict=True)
            )
            for record in records_of(recording, rig, not judges, judges or ends, held_out, number)
        ]
        return [replace(r, held=r.train) if self.turns else r for r in found]


def _number(key: str, recordings: Sequence[Recording], names: list[str], wanted: str | int) -> int:
    """Which recording is meant by a number from 1, a name, with or without its ending, or a file."""
    stems = [Path(name).stem for name in names]
    for k, (recording, name) in enumerate(zip(recordings, names, strict=True)):
        if str(wanted) in (str(k + 1), name, source_of(recording), str(recording.source)):
            return k
    if stems.count(str(wanted)) == 1:
        return stems.index(str(wanted))
    known = ", ".join(f"{k} ({name})" for k, name in enumerate(names, 1))
    other = {"validation": ", or give another file", "hold_out": f"; or {TURNS}, or {ENDS}"}.get(key, "")
    raise UserError(key, wanted, f"is none of the recordings; choose one of {known}{other}")


def _check_apart(recordings: Sequence[Recording], names: list[str], judges: list[bool]) -> None:
    """Refuse recordings of two rigs, two that are equal, and one to judge on whose samples are fitted to."""
    for k, second in enumerate(recordings):
        if second.rig and recordings[0].rig and second.rig != recordings[0].rig:
            said = f"is of the rig {second.rig}, and {names[0]} of {recordings[0].rig}: several are of one machine"
            raise UserError("recording", names[k], said)
        for j, first in enumerate(recordings[:k]):
            if judges[k] != judges[j]:
                check_apart(*((first, second) if judges[k] else (second, first)))
            elif first.samples == second.samples == shared_rows(first, second):
                raise UserError("recording", names[k], f"is equal to {names[j]}, sample by sample: give each once")


def _not_in_all(recordings: Sequence[Recording], names: list[str], rig: Rig) -> tuple[str, ...]:
    """A note on each channel of the rig that not all recordings have."""
    has = {c: [n for r, n in zip(recordings, names, strict=True) if c in r.channels] for c in rig.sensors}
    for name in names:
        if not any(name in those for those in has.values()):
            raise UserError("recording", name, f"has no channel of this rig ({', '.join(rig.sensors)})")
    return tuple(
        f"{c} is in {' and '.join(those)} only." for c, those in has.items() if 0 < len(those) < len(recordings)
    )
