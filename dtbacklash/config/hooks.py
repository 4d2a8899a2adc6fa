"""What Hydra calls around a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from dtbacklash import files


class NoteFolders(Callback):
    """Notes which folders Hydra is about to create, so that a failed run can take them away again."""

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        files.note_missing(Path(str(config.hydra.run.dir)))
