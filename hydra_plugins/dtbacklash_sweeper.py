"""Hydra plugin: the sweeper behind ``dtb run -m``. Hydra accepts sweepers from this namespace only."""

from __future__ import annotations

from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper


class ResumableSweeper(BasicSweeper):
    """Expands the choices as Hydra does; :mod:`dtbacklash.sweep` runs what is missing."""

    def sweep(self, arguments: list[str]) -> Any:
        from dtbacklash import sweep

        return sweep.run(self, arguments)
