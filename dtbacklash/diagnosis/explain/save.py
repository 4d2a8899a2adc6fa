"""The files that a diagnosis is: ``diagnosis.json``, and ``rig.yaml``, the rig with what was found, for ``rig=``.

Of a simulator's model also ``found/``, the model with what was found.
"""

from pathlib import Path

from dtbacklash.diagnosis.explain.found_model import found_model
from dtbacklash.diagnosis.result import Diagnosis
from dtbacklash.files import write_json, write_text
from dtbacklash.physics.rig_file import rig_yaml


def save(diagnosis: Diagnosis, folder: Path) -> None:
    """Write these files, each at once or not at all.

    Raises
    ------
    UserError, Failure : the folder cannot be written to, or the disk is full.
    """
    write_json(folder / "diagnosis.json", diagnosis.to_json())
    write_text(folder / "rig.yaml", rig_yaml(diagnosis.rig))
    if diagnosis.rig.config.model:
        (folder / "found").mkdir(exist_ok=True)
        for name, text in found_model(diagnosis.rig).items():
            write_text(folder / "found" / name, text)
