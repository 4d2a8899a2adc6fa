"""Hydra plugins: a user's own ``conf`` folder, rigs from any YAML file (``rig=path/to/rig.yaml``), and what is believed
of a rig (``model=NAME`` or ``model=path/to/rig.yaml``), which is a rig as well."""

from __future__ import annotations

import os
from pathlib import Path

from hydra._internal.core_plugins import file_config_source
from hydra.core.config_search_path import ConfigSearchPath, SearchPathQuery
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigLoadError, ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from dtbacklash import yaml_files
from dtbacklash.config.groups import PACKAGED, options
from dtbacklash.errors import UserError

OURS = "pkg://dtbacklash.conf"
GROUP, BELIEF = "rig/", "model/"
NO_BELIEF = "model/null"  # what takes a belief back, as one choice among others of a sweep
DATA = ("rig/", "recording/")  # groups whose files are data: not even references to other settings
SUFFIXES = (".yaml", ".yml")


class RigFileSource(ConfigSource):
    """Options of the group ``rig`` that are file names, relative to where ``dtb`` was started; the group ``model`` has
    the same, and every name of the group ``rig``."""

    @staticmethod
    def scheme() -> str:
        return "rigfile"

    def _file(self, config_path: str) -> Path | None:
        group, _, name = config_path.partition("/")
        if f"{group}/" not in (GROUP, BELIEF) or not name:
            return None
        if name.endswith(SUFFIXES):
            return Path(self.path) / name
        # the names of the group `rig` are found by Hydra itself
        return next((f for f in _named(Path(self.path), name) if f.is_file()), None) if group == "model" else None

    def load_config(self, config_path: str) -> ConfigResult:
        if config_path == NO_BELIEF:
            return ConfigResult(
                config=OmegaConf.create({"model": None}), path=self.full_path(), provider=self.provider,
                header={"package": "_global_"},
            )  # fmt: skip
        file = self._file(config_path)
        if file is None or not file.is_file():
            raise ConfigLoadError(f"Config not found: {config_path}")
        group, _, name = config_path.partition("/")
        try:
            data = yaml_files.rig_content(yaml_files.read(file.read_bytes()), file)
        except yaml_files.Mistake as mistake:
            raise UserError(group, name, str(mistake)) from mistake
        except OSError as error:
            raise UserError(group, name, f"cannot be read: {(error.strerror or str(error)).lower()}") from error
        if not isinstance(data, dict):
            raise UserError(group, name, "must be a YAML file that describes a rig")
        return ConfigResult(
            config=OmegaConf.create(data), path=self.full_path(), provider=self.provider, header={"package": None}
        )

    def available(self) -> bool:
        return True

    def is_group(self, config_path: str) -> bool:
        return config_path == BELIEF.rstrip("/")

    def is_config(self, config_path: str) -> bool:
        file = self._file(config_path)
        return config_path == NO_BELIEF or (file is not None and file.is_file())

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        return options("rig") if config_path == BELIEF.rstrip("/") else []


def _named(here: Path, name: str) -> list[Path]:
    """Where a rig of this name may stand: in the user's ``conf``, then in ours."""
    return [folder / GROUP / f"{name}{suffix}" for folder in (here / "conf", PACKAGED) for suffix in SUFFIXES]


class UserConfSource(file_config_source.FileConfigSource):
    """The ``conf`` folder of a user: Hydra's folder of files, each of them checked before it is loaded."""

    @staticmethod
    def scheme() -> str:
        return "userconf"

    def is_group(self, config_path: str) -> bool:
        # laws of one's own are read where the catalogue is; `effect` is a setting of dtb conceal
        return config_path != "effect" and super().is_group(config_path)

    def load_config(self, config_path: str) -> ConfigResult:
        file, content = Path(self.path) / self._normalize_file_name(config_path), None
        if file.is_file():
            try:
                if config_path.startswith(DATA):
                    content = yaml_files.read(file.read_bytes())
                    content = yaml_files.rig_content(content) if config_path.startswith(GROUP) else None
                else:  # Hydra's own settings need its resolvers: ${now:...} in a folder's name
                    hydra = config_path.startswith("hydra") or "/" not in config_path
                    yaml_files.check(file.read_bytes(), resolvers=hydra)
            except yaml_files.Mistake as mistake:
                raise UserError(
                    config_path.partition("/")[0], f"conf/{self._normalize_file_name(config_path)}", str(mistake)
                ) from mistake
        found = super().load_config(config_path)
        if content is not None:
            found.config = OmegaConf.create(content)
        return found


class DtbSearchPath(SearchPathPlugin):
    """Extends the ``conf`` of ``dtb``, and of no other Hydra application, by what the user brings."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        if not any(element.path == OURS for element in search_path.get_path()):
            return
        here = os.getcwd()
        user = Path(here) / "conf"
        # first match wins: a user's option replaces ours of the same name
        if user.is_dir() and not (user / "__init__.py").exists():
            search_path.prepend("user", f"userconf://{user}", anchor=SearchPathQuery(provider="main"))
        search_path.append("rigfile", f"rigfile://{here}")
