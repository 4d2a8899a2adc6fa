"""Diagnosis: where a recording and the simulation differ, what physics is missing, and whether it fits better."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from dtbacklash.diagnosis.explain.accepted_error import Enough, read_enough
from dtbacklash.diagnosis.explain.error_names import names_the_recording
from dtbacklash.diagnosis.explain.observability_notes import beforehand
from dtbacklash.diagnosis.explain.sentences import notes_of, notes_of_several, units_of
from dtbacklash.diagnosis.explain.warnings import doubted, said_first
from dtbacklash.diagnosis.per_recording_parameters import Given, Own, with_own
from dtbacklash.diagnosis.pipeline import FULL, diagnose_records
from dtbacklash.diagnosis.preliminary import Depth
from dtbacklash.diagnosis.records import Record, check_parts, long_enough, records_of, while_it_moves
from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.diagnosis.settings import SETTINGS
from dtbacklash.diagnosis.several import ENDS, Several, source_of
from dtbacklash.errors import UserError
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording
from dtbacklash.recording.validation import check_alike, check_apart

__all__ = ["Diagnosis", "Record", "diagnose", "diagnose_records", "records_of"]

#: what judges: another recording, or several; or which of several recordings (number from 1, name) does
Validation = Recording | Sequence[Recording] | str | int

#: what two recordings are compared for
CHANGE = "change"


@names_the_recording
def diagnose(
    recording: Recording | Sequence[Recording],
    rig: Rig,
    validation: Validation | None = None,
    held_out: float | None = None,
    progress: Callable[[str, float], None] | None = None,
    jobs: int | None = None,
    units: dict[str, str] | None = None,
    enough: Mapping[str, object] | None = None,
    depth: Depth = FULL,
    keep: bool = False,
    own: Own | None = None,
    given: Given | None = None,
    hold_out: str | int | None = None,
    compare: str | None = None,
) -> Diagnosis:
    """Diagnose a recording, or several together, on a rig.

    Parameters
    ----------
    recording, validation : to fit, and to judge on; without the second the last share ``held_out`` of the first, or of
        each of several, judges (None: as the settings say). Of several, ``validation`` may be the number (from 1) or
        the name of one.
    rig : the nominal rig. progress : called with what is being done and a share, 0 to 1.
    jobs : threads that share the work; None leaves what ``joblib.parallel_config`` says, else one.
    units : channel -> the unit that was read, and who says so, for the report; None: as the recording has it.
    enough : channel -> what is good enough, see :func:`.read_enough`.
    depth : how much is looked for: ``none`` calibrates the rig as it is, ``quick`` names what is large, ``full`` all.
    keep : whether Ctrl-C gives what is known so far (:attr:`Diagnosis.stopped`).

    own : of several recordings, the parameters and effects that are free in each, or, per recording (name or number),
        there. given : recording -> parameter -> the value that is known there, SI or a text with its unit.

    Several recordings share the rig's physics and parameters. Each has its own sample time, channels, first state, and
    sizes of what is unknown.

    Raises
    ------
    UserError : no channel of the rig was recorded, or a recording has none; an integrating part not measured, too
        little is left to fit to or to judge on; the validation repeats the recording, is none of
        several, or, of one recording, lacks one of its channels or has another sample time.
    """
    accepted = read_enough(enough or {}, rig)
    held_out_given, held_out = held_out is not None, SETTINGS.held_out_share if held_out is None else held_out
    fitted = [recording] if isinstance(recording, Recording) else recording
    judging = [] if validation is None or isinstance(validation, (str, int)) else validation
    doubts = doubted(rig, [*fitted, *([judging] if isinstance(judging, Recording) else judging)])
    recordings = [while_it_moves(one, rig) for one in fitted]
    if isinstance(validation, Recording):
        validation = while_it_moves(validation, rig)
    if len(recordings) == 1 and (own or given):
        with_own(rig, 1, lambda key, wanted: 0, own, given)
    if compare is not None and (compare != CHANGE or len(recordings) != 2):
        allowed = f"is of two recordings, recording=[before.csv,after.csv], not of {len(recordings)}"
        raise UserError("compare", compare, allowed if compare == CHANGE else f"choose {CHANGE}, of two recordings")
    if hold_out is not None and (held_out_given or isinstance(hold_out, bool) or not isinstance(hold_out, (str, int))):
        allowed = "says what judges, and so does held_out: give one" if held_out_given else "is no name or number"
        raise UserError("hold_out", hold_out, allowed)
    if len(recordings) == 1 and hold_out not in (None, ENDS):
        raise UserError("hold_out", hold_out, "leaves out one of several: give several, recording=[a.csv,b.csv]")
    if len(recordings) == 1 and (validation is None or isinstance(validation, Recording)):
        found = _one(recordings[0], rig, validation, held_out, progress, jobs, units, accepted, depth, keep)
        return said_first(found, fitted, doubts)
    others = [validation] if isinstance(validation, Recording) else validation
    if held_out_given and hold_out is None and others is None:
        hold_out = ENDS
    several = Several.of(recordings, others, rig, hold_out)
    if compare is not None and any(several.judges[:2]):
        raise UserError("compare", compare, "needs both recordings, and one of them judges alone: leave that out")
    rig = with_own(rig, len(several.recordings), several.number, own, given)
    records, left_out = long_enough(several.records(rig, held_out))
    check_parts(records, ("validation", several.judging) if several.judging else ("held_out", held_out))
    found = diagnose_records(rig, records, progress, jobs, accepted, depth, keep, compare == CHANGE)
    used = tuple(several.used(records, found.recordings))
    untold = beforehand(rig, several.recordings[0].channels)
    notes = *notes_of_several(several, held_out), *untold, *left_out, *found.notes
    read = units_of(several) if units is None else dict(units)
    found = replace(found, source=", ".join(several.names), notes=notes, units=read, recordings=used)
    return said_first(found, fitted, doubts)


def _one(
    recording: Recording, rig: Rig, validation: Recording | None, held_out: float,
    progress: Callable[[str, float], None] | None, jobs: int | None, units: dict[str, str] | None, enough: Enough,
    depth: Depth, keep: bool,
) -> Diagnosis:  # fmt: skip
    """The diagnosis of one recording."""
    if validation is None:
        records = records_of(recording, rig, True, True, held_out)
    else:
        check_alike(recording, validation, rig.sensors)
        check_apart(recording, validation)
        records = records_of(recording, rig, True, False) + records_of(validation, rig, False, True, number=1)
    records, left_out = long_enough(records)
    check_parts(records, ("held_out", held_out) if validation is None else ("validation", validation.name))
    found = diagnose_records(rig, records, progress, jobs, enough, depth, keep)
    notes = *notes_of(recording, validation, held_out), *beforehand(rig, recording.channels), *left_out
    read = recording.assumed_units if units is None else units
    return replace(found, source=source_of(recording), notes=(*notes, *found.notes), units=dict(read))
