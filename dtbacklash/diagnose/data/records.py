"""From a recording to records: its stretches without a gap, as far as they are long enough."""

import numpy as np

from dtbacklash.diagnose.data.compare import Record, longest_step_s, part_of, slowest_decay
from dtbacklash.diagnose.data.pull import cut
from dtbacklash.diagnose.data.tempo import tempo_rad_s
from dtbacklash.diagnose.settings import SETTINGS
from dtbacklash.physics.assembly import compile_plant
from dtbacklash.physics.rig import Rig
from dtbacklash.recording.model import Recording

#: a shorter stretch beside others shows mostly the state in which it began (slowest decays)
STRETCH_DECAYS_MIN = 1.0


def records_of(
    recording: Recording, rig: Rig, train: bool, held: bool, share: float | None = None, number: int = 0
) -> list[Record]:
    """The stretches of a recording with their masks: all samples for one purpose, or the last ``share`` held out.

    share : None: as in the settings. number : of the recording.
    """
    n = recording.samples
    share = SETTINGS.held_out_share if share is None else share
    cut_at = n - round(share * n) if train and held else n * train
    mask = np.arange(n) < cut_at
    columns = {c: np.ascontiguousarray(v, dtype=float) for c, v in recording.channels.items()}
    measured = {c: v for c, v in columns.items() if c in rig.sensors}
    return [
        Record(
            recording.sample_time_s, columns["u"][a:b], {c: v[a:b] for c, v in measured.items()}, mask[a:b], ~mask[a:b],
            float(recording.t_s[a] - recording.t_s[0]), recording=number,
        )
        for a, b in recording.stretches
    ]  # fmt: skip


def long_enough(rig: Rig, records: list[Record]) -> tuple[list[Record], tuple[str, ...]]:
    """The records that are long enough for the rig's slowest decay, and a note on those that are left out.

    A recording in one piece is never left out, and nothing is if no training or no held-out part would remain.

    Raises
    ------
    UserError : as :func:`.pull.cut`.
    """
    stretches = [r for k, r in enumerate(records) if r.from_s > 0.0 or (k + 1 < len(records) and records[k + 1].from_s)]
    if not stretches:
        return records, ()
    slowest = slowest_decay_of(rig, records)

    def least(step: float) -> int:
        return max(SETTINGS.beginning_samples_min, round(STRETCH_DECAYS_MIN / slowest / step))

    short = [r for r in stretches if r.samples < least(r.sample_time_s)]
    kept = [r for r in records if not any(r is s for s in short)]
    if not short or not any(r.train.any() for r in kept) or not any(r.held.any() for r in kept):
        return records, ()
    count, lost, step = len(short), sum(r.samples for r in short), longest_step_s(short)
    return kept, (
        f"{count} of {len(stretches)} stretches ({lost} samples) {'is' if count == 1 else 'are'} left out, being "
        f"shorter than {least(step) * step:.3g} s: too short beside the slowest decay of the rig.",
    )


def slowest_decay_of(rig: Rig, records: list[Record]) -> float:
    """Slowest decay rate of the blocks into which recordings cut a rig, 1/s; errors as :func:`.pull.cut`."""
    step = longest_step_s(records)
    blocks = cut(rig, tuple(n for n in rig.sensors if all(n in r.y for r in records)), step, tempo_rad_s(rig, records))
    plants = [compile_plant(part_of(rig, b), step, imposed=b.imposed is not None) for b in blocks]
    return min(slowest_decay(plant, block) for plant, block in zip(plants, blocks, strict=True))
