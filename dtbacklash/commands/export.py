"""``dtb export fmu``: a rig as an FMU, for other simulation tools."""

from __future__ import annotations

from collections.abc import Sequence

from dtbacklash.config.grammar import EXPORT
from dtbacklash.errors import UserError

FMU = "fmu"


def main(words: Sequence[str]) -> int:
    """Run ``dtb export``; returns the exit code.

    Raises
    ------
    UserError : whatever the user got wrong.
    """
    if not words or words[0] != FMU:
        raise UserError("argument", words[0] if words else "(missing)", "write dtb export fmu")
    option = next((word for word in words if word.startswith("-")), None)
    if option is not None:
        raise UserError("option", option, "dtb export fmu takes --help, and settings as key=value")
    hydra = next((word for word in words if word.lstrip("+~").startswith("hydra")), None)
    if hydra is not None:
        key, _, value = hydra.partition("=")
        raise UserError(key, value, "no such setting; dtb export fmu --help lists them")
    _export(words[1:])
    return 0


def _export(words: Sequence[str]) -> None:
    from dtbacklash.commands.console import shown_path
    from dtbacklash.config.commands import ExportConfig
    from dtbacklash.config.compose import compose_for
    from dtbacklash.fmu import export, interface
    from dtbacklash.physics.rig import build_rig

    export.check_extra()
    config = compose_for(EXPORT, ExportConfig, *words)
    content = interface.Export(build_rig(config.rig), config.sample_time_s, config.substeps, config.event_levels)
    file = export.write_fmu(content, export.target(config.out, content), config.out)
    offered = interface.variables(content.rig)
    for causality in (interface.INPUT, interface.OUTPUT, interface.PARAMETER):
        print(f"{causality + 's':<10} " + ", ".join(one.name for one in offered if one.causality == causality))
    print(f"it needs dtbacklash {content.version} in the Python of whoever imports it")
    print(shown_path(file))
