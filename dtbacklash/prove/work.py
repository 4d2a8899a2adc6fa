"""What a worker does with one case: diagnose it, or let the oracle look at it; each result is one whole file."""

from __future__ import annotations

import os
import signal
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dtbacklash import sources
from dtbacklash.errors import UserError
from dtbacklash.prove.seal import PUBLIC, RECORDING
from dtbacklash.prove.store import read_json, write_json

#: the parts of the package that a diagnosis is made by: a case that other code diagnosed is diagnosed again
DIAGNOSED_BY = ("compiled.py", "config", "physics", "control", "recording", "diagnose")
ORACLE_BY = (*DIAGNOSED_BY, "prove/oracle.py")

#: (folder of the case, nominal rig's name) -> (content of diagnosis.json, the extended rig's description)
Diagnose = Callable[[Path, str], tuple[dict[str, Any], dict[str, Any]]]
#: (folder of the case, nominal rig's name, secret, description of the extended rig or None) -> what the oracle says
Oracle = Callable[[Path, str, dict[str, Any], dict[str, Any] | None], dict[str, Any]]


def diagnose_folder(folder: Path, rig_name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Diagnose the recording of a case from what is public of it."""
    from dtbacklash.diagnose import diagnose
    from dtbacklash.prove.conceal import nominal_rig
    from dtbacklash.prove.oracle import described
    from dtbacklash.recording import read_recording

    rig = nominal_rig(rig_name)
    result = diagnose(read_recording(folder / RECORDING, rig=rig), rig)
    return result.to_json(), described(result.extended)


def oracle_folder(
    folder: Path, rig_name: str, secret: dict[str, Any], extended: dict[str, Any] | None
) -> dict[str, Any]:
    """Let the oracle look at a case; by now its seal is open."""
    from dtbacklash.diagnose import record_of
    from dtbacklash.diagnose.evidence import Evidence
    from dtbacklash.prove.conceal import nominal_rig
    from dtbacklash.prove.oracle import look, rebuilt
    from dtbacklash.recording import read_recording

    rig = nominal_rig(rig_name)
    record = record_of(read_recording(folder / RECORDING, rig=rig), rig, True, True)
    return look(Evidence.gather(rig, [record]), secret, rebuilt(rig, extended) if extended else None)


def rig_of(folder: Path, chosen: str | None) -> str:
    """The name or file of a case's nominal rig: the one that was chosen, else the one that the case names.

    Raises
    ------
    UserError : neither says which.
    """
    name = chosen or read_json(folder / PUBLIC).get("rig")
    if not name:
        raise UserError("folder", folder, f"its {PUBLIC} names no rig; give rig=")
    return str(name)


def conceal_case(seed: int, rig_name: str, folder: Path, key_file: Path) -> None:
    """Make one concealed recording."""
    from dtbacklash.prove.conceal import conceal

    _as_worker()
    conceal(seed, rig_name, folder, key_file=key_file, keep=True)


def diagnose_case(folder: Path, target: Path, rig_name: str, diagnose: Diagnose = diagnose_folder) -> None:
    """Diagnose one case into ``target``. A diagnosis that fails is a result: it counts against the tool."""
    _as_worker()
    entry: dict[str, Any] = {"id": folder.name, "code": sources.digest(DIAGNOSED_BY), "error": ""}
    begin = time.perf_counter()
    try:
        with _alone():
            diagnosis, extended = diagnose(folder, rig_name)
        entry |= {"diagnosis": diagnosis, "extended": extended}
    except Exception as error:
        why = str(error) if isinstance(error, UserError) else f"{type(error).__name__}: {error}"
        details = "" if isinstance(error, UserError) else "".join(traceback.format_exception(error))
        entry |= {"diagnosis": None, "extended": None, "error": " ".join(why.split()), "traceback": details}
    write_json(target, entry | {"wall_s": time.perf_counter() - begin})


def oracle_case(
    folder: Path, target: Path, rig_name: str, secret: dict[str, Any], oracle: Oracle = oracle_folder
) -> None:
    """Add what the oracle says of one case to its file; an oracle that fails leaves its reason there."""
    _as_worker()
    entry = read_json(target)
    try:
        with _alone():
            seen = oracle(folder, rig_name, secret, entry["extended"])
    except Exception as error:
        seen = {"error": " ".join(f"{type(error).__name__}: {error}".split())}
    write_json(target, entry | {"secret": secret, "oracle": seen | {"code": sources.digest(ORACLE_BY)}})


def record_death(folder: Path, target: Path) -> None:
    """Write down that the process which diagnosed a case died, twice."""
    write_json(target, {
        "id": folder.name, "code": sources.digest(DIAGNOSED_BY), "diagnosis": None, "extended": None,
        "error": "its worker died", "wall_s": None,
    })  # fmt: skip


def diagnosed(target: Path) -> bool:
    """Whether this code has diagnosed the case."""
    return read_json(target).get("code") == sources.digest(DIAGNOSED_BY)


def looked_at(target: Path) -> bool:
    """Whether this code's oracle has looked at the case, after this code's diagnosis."""
    seen = read_json(target).get("oracle") or {}
    return diagnosed(target) and seen.get("code") == sources.digest(ORACLE_BY)


def has_oracle(target: Path) -> bool:
    """Whether an oracle, of whatever code, has looked at the case."""
    return bool(read_json(target).get("oracle"))


def forget_oracle(target: Path) -> None:
    """Take out what an oracle of other code said."""
    entry = read_json(target)
    if entry.pop("oracle", None):
        write_json(target, entry)


_parent = os.getpid()


def _as_worker() -> None:
    """In a process of its own: leave Ctrl-C to the parent, which ends the workers."""
    import multiprocessing

    child = multiprocessing.parent_process() is not None or os.getpid() != _parent
    if child and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _alone() -> Any:
    """Keep whatever the diagnosis would spread over processes of its own within this worker."""
    from joblib import parallel_config

    return parallel_config("sequential")
