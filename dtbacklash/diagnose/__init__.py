"""Diagnosis: where a recording and the simulation differ, what physics is missing, and whether it fits better."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from dtbacklash.diagnose.data.compare import Record
from dtbacklash.diagnose.data.records import long_enough, records_of
from dtbacklash.diagnose.judge.explained import read_enough
from dtbacklash.diagnose.pipeline import diagnose_records
from dtbacklash.diagnose.result import Diagnosis
from dtbacklash.diagnose.say.error_names import names_the_recording
from dtbacklash.diagnose.say.sentences import notes_of, source_of
from dtbacklash.diagnose.search.parts import check_parts
from dtbacklash.diagnose.settings import settings as in_force
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording
from dtbacklash.recording.validation import check_alike, check_apart

__all__ = ["Diagnosis", "Record", "diagnose", "diagnose_records", "records_of"]


@names_the_recording
def diagnose(
    recording: Recording,
    rig: Rig,
    validation: Recording | None = None,
    held_out: float | None = None,
    progress: Callable[[str, float], None] | None = None,
    jobs: int | None = None,
    units: dict[str, str] | None = None,
    enough: Mapping[str, object] | None = None,
) -> Diagnosis:
    """Diagnose a recording on a rig.

    Parameters
    ----------
    recording, validation : to fit, and to choose and judge on; without the second the last share ``held_out`` of the
        first does so (None: as the settings say). What chooses is fitted to in the end, and what judges comes last.
    rig : the nominal rig. progress : called with what is being done and a share, 0 to 1.
    jobs : threads that share the work; None leaves what ``joblib.parallel_config`` says, else one.
    units : channel -> the unit that was read, and who says so, for the report; None: as the recording has it.
    enough : channel -> what is good enough, see :func:`.explained.read_enough`.

    Raises
    ------
    UserError : no channel of the rig was recorded, an integrating part not measured, nothing was commanded, too little
        is left to fit to or to judge on, or the validation repeats the recording, lacks one of its channels, or has
        another sample time.
    """
    accepted = read_enough(enough or {}, rig)
    held_out = in_force().held_out_share if held_out is None else held_out
    if validation is None:
        records = records_of(recording, rig, True, True, held_out)
    else:
        check_alike(recording, validation, rig.sensors)
        check_apart(recording, validation)
        records = records_of(recording, rig, True, False) + records_of(validation, rig, False, True)
    records, left_out = long_enough(rig, records)
    check_parts(records, ("held_out", held_out) if validation is None else ("validation", validation.name))
    found = diagnose_records(rig, records, progress, jobs, accepted)
    notes = *notes_of(recording, validation, held_out), *left_out
    read = recording.assumed_units if units is None else units
    return replace(found, source=source_of(recording), notes=(*notes, *found.notes), units=dict(read))
