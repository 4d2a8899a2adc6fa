"""The jobs of a proof: conceal a case, diagnose it, ask the oracle about it; each writes one file."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dtbacklash import source_hash
from dtbacklash.campaign.jobs import Job
from dtbacklash.errors import Failure, UserError
from dtbacklash.files import read_json, write_json
from dtbacklash.prove.seal import PUBLIC, RECORDING

#: on which the recording of a seed depends: modules with all that they import, and the settings that these read
CONCEALED_BY = ("dtbacklash.prove.conceal", "conf/rig", "physics/laws")
#: on which a diagnosis depends: when it changes, a case is diagnosed again
DIAGNOSED_BY = (
    *(f"dtbacklash.{name}" for name in ("diagnosis", "recording", "config.compose", "physics.rig_file")),
    "conf/rig", "physics/laws",
)  # fmt: skip
ORACLE_BY = (*DIAGNOSED_BY, "dtbacklash.prove.oracle", "dtbacklash.prove.draw")
DEATH = "its worker died"

#: (folder of the case, nominal rig's name) -> (content of diagnosis.json, the extended rig as in its file)
Diagnose = Callable[[Path, str], tuple[dict[str, Any], dict[str, Any]]]
#: (folder of the case, nominal rig's name, secret, the extended rig or None) -> the oracle's answer
Oracle = Callable[[Path, str, dict[str, Any], dict[str, Any] | None], dict[str, Any]]


def diagnose_folder(folder: Path, rig_name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Diagnose the recording of a case from its public files."""
    from dtbacklash.diagnosis import diagnose
    from dtbacklash.physics.rig_file import rig_content
    from dtbacklash.prove.conceal import nominal_rig
    from dtbacklash.recording import read_recording

    rig = nominal_rig(rig_name)
    result = diagnose(read_recording(folder / RECORDING, rig=rig), rig)
    return result.to_json(), rig_content(result.extended)


def oracle_folder(
    folder: Path, rig_name: str, secret: dict[str, Any], extended: dict[str, Any] | None
) -> dict[str, Any]:
    """Ask the oracle about a case whose seal is open."""
    from dtbacklash.diagnosis.records import records_of
    from dtbacklash.physics import rig_file
    from dtbacklash.prove.conceal import nominal_rig
    from dtbacklash.prove.draw import record
    from dtbacklash.prove.oracle import look
    from dtbacklash.prove.secret import Secret
    from dtbacklash.recording import read_recording

    rig = nominal_rig(rig_name)
    (seen,) = records_of(read_recording(folder / RECORDING, rig=rig), rig, True, True)
    truth = record(Secret(**secret), rig)[1].truth if secret["kind"] == "unknown" else None
    return look(rig, seen, secret, rig_file.rig_of(extended) if extended else None, truth)


def rig_of(folder: Path, chosen: str | None) -> str:
    """The name or file of a case's nominal rig: the chosen one, else the one that the case names.

    Raises UserError: neither says which.
    """
    name = chosen or read_json(folder / PUBLIC).get("rig")
    if not name:
        raise UserError("folder", folder, f"its {PUBLIC} names no rig; give rig=")
    beside = folder / str(name)  # a rig of its own lies with the recordings
    return str(beside.resolve()) if not chosen and beside.is_file() else str(name)


@dataclass(frozen=True)
class ConcealCase(Job):
    """Make one concealed recording in the folder ``record``; for the attributes see :func:`.conceal.conceal`."""

    record: Path
    seed: int
    rig: str
    key_file: Path
    machine: str = "clean"

    def done(self) -> bool:
        return self.record.exists()

    def work(self) -> None:
        from dtbacklash.prove.conceal import conceal

        conceal(self.seed, self.rig, self.record.parent, key_file=self.key_file, keep=True, machine=self.machine)

    def died(self, error: Exception | None) -> None:
        raise error or Failure("seed", self.seed, f"no recording came of it: {DEATH}")


@dataclass(frozen=True)
class DiagnoseCase(Job):
    """Diagnose the case in ``folder`` into the file ``record``; a diagnosis that fails is a result, too."""

    record: Path
    folder: Path
    rig: str
    diagnose: Diagnose = diagnose_folder

    def done(self) -> bool:
        return diagnosed(self.record)

    def work(self) -> None:
        code, wall_s, cpu_s = source_hash.digest(DIAGNOSED_BY), time.perf_counter(), time.process_time()
        answer: dict[str, Any] = {"error": "", "diagnosis": None, "extended": None}
        try:
            answer["diagnosis"], answer["extended"] = self.diagnose(self.folder, self.rig)
        except Exception as error:
            mistake = isinstance(error, UserError)
            why = str(error) if mistake else f"{type(error).__name__}: {error}"
            answer["error"] = " ".join(why.split())
            answer["traceback"] = "" if mistake else "".join(traceback.format_exception(error))
        times = {"wall_s": time.perf_counter() - wall_s, "cpu_s": time.process_time() - cpu_s}
        write_json(self.record, {"id": self.folder.name, "code": code, **answer, **times})

    def died(self, error: Exception | None) -> None:
        nothing = dict.fromkeys(("diagnosis", "extended", "wall_s", "cpu_s"))
        code = source_hash.digest(DIAGNOSED_BY)
        write_json(self.record, {"id": self.folder.name, "code": code, "error": DEATH, **nothing})


@dataclass(frozen=True)
class AskOracle(Job):
    """Add the oracle's answer about a case, or why it failed, to the file ``record``."""

    record: Path
    folder: Path
    rig: str
    secret: dict[str, Any]
    oracle: Oracle = oracle_folder

    def done(self) -> bool:
        seen = read_json(self.record).get("oracle") or {}
        return diagnosed(self.record) and seen.get("code") == source_hash.digest(ORACLE_BY)

    def work(self) -> None:
        try:
            seen = self.oracle(self.folder, self.rig, self.secret, read_json(self.record)["extended"])
        except Exception as error:
            seen = {"error": " ".join(f"{type(error).__name__}: {error}".split())}
        self._tell(seen)

    def died(self, error: Exception | None) -> None:
        self._tell({"error": DEATH})

    def _tell(self, seen: dict[str, Any]) -> None:
        entry = read_json(self.record) | {"secret": self.secret}
        write_json(self.record, entry | {"oracle": seen | {"code": source_hash.digest(ORACLE_BY)}})


def diagnosed(target: Path) -> bool:
    """Whether this code has diagnosed the case."""
    return read_json(target).get("code") == source_hash.digest(DIAGNOSED_BY)
