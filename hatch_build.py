"""Compiles the libraries in C when the package is built, or installed in place."""

import runpy
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CoreBuildHook(BuildHookInterface):
    """Wheels hold libraries for this platform, which any Python loads."""

    def _build(self) -> dict[str, Any]:
        return runpy.run_path(str(Path(self.root) / "dtbacklash" / "core" / "build.py"))

    def dependencies(self) -> list[str]:
        """The compiler of the package ziglang where there is no other."""
        return [] if self._build()["compiler"]() else ["ziglang>=0.13"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the libraries beside their sources, from where they go into the wheel."""
        self._build()["make"]()
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data |= {"pure_python": False, "tag": f"py3-none-{platform}"}
