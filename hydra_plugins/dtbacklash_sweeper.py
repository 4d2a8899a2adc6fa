"""Hydra plugin: the sweeper behind ``-m``. Hydra accepts sweepers from this namespace only."""

from __future__ import annotations

from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper


class ResumableSweeper(BasicSweeper):
    """Expands the choices as Hydra does; :mod:`dtbacklash.campaign.sweep` runs what is missing."""

    def sweep(self, arguments: list[str]) -> Any:
        from dtbacklash.campaign import sweep

        return sweep.run(self, arguments)
