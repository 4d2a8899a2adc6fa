"""Make a concealed recording: draw, record, seal; its folder is written completely or not at all."""

from __future__ import annotations

import gzip
import io
import json
from dataclasses import replace
from pathlib import Path

import pandas as pd

from dtbacklash.errors import UserError
from dtbacklash.files import json_text, written
from dtbacklash.physics.rig import Rig
from dtbacklash.prove import seal
from dtbacklash.prove.draw import check_choices, draw, record
from dtbacklash.prove.secret import Secret
from dtbacklash.prove.simulator.given import Loop
from dtbacklash.prove.simulator.rig import Trial, check_concealable


def nominal_rig(name: str) -> Rig:
    """The rig called ``name`` (or in a YAML file), as ``rig=`` takes it in the other commands.

    Raises UserError: no such rig, or something in it is wrong.
    """
    from dtbacklash.config.compose import compose
    from dtbacklash.physics.rig import build_rig

    return build_rig(compose("controller=open_loop", f"rig={name}").rig)


def conceal(
    seed: int,
    rig_name: str | Rig,
    folder: Path | str,
    *,
    kind: str | None = None,
    effect: str | None = None,
    instruments: str | None = None,
    key_file: Path | str | None = None,
    keep: bool = False,
    called: str | None = None,
    machine: str = "clean",
) -> Path:
    """Make one concealed recording.

    seed : the same seed and key give the same case and recording.
    rig_name : a rig's name or file, or the rig itself. folder : where the case's folder is made.
    kind, effect, instruments : choices that are otherwise drawn; they and ``machine``: see :func:`.draw.draw`.
    key_file : made if there is none. Default: ``<folder>.key``. keep : return an existing case instead of refusing it.
    called : the rig's name or file (relative to the case) in the public files. Default: the rig's name.

    Returns ``folder/<id>`` with ``recording.csv.gz``, ``public.json`` (rig, channels) and ``sealed.json``.

    Raises UserError: an impossible choice, a case that exists already, a folder or key that cannot be used.
    """
    folder = Path(folder).absolute()
    rig = nominal_rig(rig_name) if isinstance(rig_name, str) else rig_name
    key_file = Path(key_file) if key_file is not None else seal.key_path(folder)
    seal.check_apart(key_file, folder, "recordings")
    check_concealable(rig)
    check_choices(rig, kind, effect, instruments)
    key = seal.read_or_make_key(key_file)
    case = folder / case_id(seed, rig, key, kind, effect, instruments, machine)
    if case.exists():
        if keep:
            return case
        raise UserError("seed", seed, f"its recording is there already: {case}")
    secret = draw(seed, rig, kind, effect, instruments, machine)
    if called is not None or isinstance(rig_name, str):
        secret = replace(secret, rig=called or str(rig_name))
    write_case(case, secret, rig, key)
    return case


def case_id(
    seed: int, rig: Rig, key: bytes, kind: str | None = None, effect: str | None = None,
    instruments: str | None = None, machine: str = "clean",
) -> str:  # fmt: skip
    """The name of a case, which tells nothing about the seed without the key."""
    more = [] if machine == "clean" else [machine]
    words = json.dumps([seed, rig.config.name, kind, effect, instruments, *more])
    return seal.keyed_hash(key, words).hex()[:12]


def write_case(case: Path, secret: Secret, nominal: Rig, key: bytes) -> None:
    """Record a secret and seal it into the folder ``case``, complete or not at all.

    Raises UserError: it cannot be written.
    """
    loop, run = record(secret, nominal)
    content = csv_gz(recording_table(secret, nominal, loop, run))
    public = {"rig": secret.rig, "channels": secret.channels}
    with written(case, shown=case.parent) as scratch:
        scratch.mkdir()
        (scratch / seal.RECORDING).write_bytes(content)
        (scratch / seal.PUBLIC).write_text(json_text(public), encoding="utf-8")
        (scratch / seal.SEALED).write_text(json_text(seal.seal(secret, content, key)), encoding="utf-8")


def recording_table(secret: Secret, nominal: Rig, loop: Loop, run: Trial) -> pd.DataFrame:
    """The recording in the columns and units that the rig declares, as ``dtb run recording.save=`` writes it."""
    t_s = [round(k * secret.sample_time_s, 9) for k in range(len(run.u))]
    reference = loop.reference * (nominal.reference_per_si() if loop.closed else 1.0)
    seen = {name: run.seen[name] * nominal.sensors[name].per_si + 0.0 for name in secret.channels}  # + 0.0: no -0
    return pd.DataFrame({"t": t_s, "r": reference + 0.0, "u": run.u + 0.0, **seen})


def csv_text(table: pd.DataFrame, digits: int = 12) -> str:
    """A table as CSV, its numbers with so many significant digits."""
    return table.to_csv(index=False, float_format=f"%.{digits}g", lineterminator="\n")


def csv_gz(table: pd.DataFrame) -> bytes:
    """A table as gzipped CSV without file name and date: the same bytes for the same table."""
    buffer = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", fileobj=buffer, mtime=0, compresslevel=6) as file:
        file.write(csv_text(table).encode())
    return buffer.getvalue()
