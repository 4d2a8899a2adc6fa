"""``dtb export``: a rig as an FMU, for other simulation tools, or a controller as C99, for a machine."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dtbacklash.config.grammar import EXPORT, RUN
from dtbacklash.errors import UserError

if TYPE_CHECKING:
    from dtbacklash.config.run import RunConfig
    from dtbacklash.control.belief import Belief
    from dtbacklash.control.design import ControllerDesign

FMU, CONTROLLER = "fmu", "controller"
C_SUFFIX, FMU_SUFFIX = ".c", ".fmu"
#: of the voltage, where neither the controller nor the model has a limit
LIMIT_V = 12.0
#: words of `dtb export controller` beside the settings of `dtb run`
OWN = ("out", "fmi", "with_twin")


def main(words: Sequence[str]) -> int:
    """Run ``dtb export``; returns the exit code; raises UserError: whatever the user got wrong."""
    if not words or words[0] not in (FMU, CONTROLLER):
        allowed = "write dtb export fmu, or dtb export controller"
        raise UserError("argument", words[0] if words else "(missing)", allowed)
    program = f"dtb export {words[0]}"
    option = next((word for word in words if word.startswith("-")), None)
    if option is not None:
        raise UserError("option", option, f"{program} takes --help, and settings as key=value")
    hydra = next((word for word in words if word.lstrip("+~").startswith("hydra")), None)
    if hydra is not None:
        key, _, value = hydra.partition("=")
        raise UserError(key, value, f"no such setting; {program} --help lists them")
    (_export if words[0] == FMU else _export_controller)(words[1:])
    return 0


def _export_controller(words: Sequence[str]) -> None:
    from dtbacklash.commands.console import shown_path
    from dtbacklash.config.compose import compose_for
    from dtbacklash.config.run import RunConfig
    from dtbacklash.control.belief import beliefs_of, design_for, settled
    from dtbacklash.control.c99 import USE, c_source, c_test
    from dtbacklash.control.laws import build_controller
    from dtbacklash.files import written
    from dtbacklash.fmu.controller import write_controller
    from dtbacklash.twin.c99 import USE as TWIN_USE
    from dtbacklash.version import __version__

    own = {key: value for key, _, value in (word.partition("=") for word in words) if key in OWN}
    others = (word for word in words if word.partition("=")[0] not in own)
    config = compose_for(replace(RUN, beside=OWN), RunConfig, *others)
    beliefs = beliefs_of(config)
    config = settled(config, beliefs)
    c = replace(config.controller, limit_v=config.controller.limit_v or LIMIT_V)
    design = design_for(config, beliefs.design)
    if design is None:
        raise UserError("controller", c.name, "open loop has no controller to export")
    forward = beliefs.design.feed_forward(tuple(c.compensate))
    first_rad = math.radians(c.gap_hat_deg or 0.0)
    about = f"{c.name} for {beliefs.design.rig.config.name}, made by dtbacklash {__version__}: " + " ".join(words)
    path, fmi, with_twin = _form(own, c.name + C_SUFFIX)
    controller = build_controller(c, design, forward)
    source = c_source(controller, first_rad, about, TWIN_USE if with_twin else USE)
    if with_twin:
        source += _twin(config, beliefs.twin, design)
    if path.suffix == FMU_SUFFIX:
        name = re.sub(r"\W", "_", c.name, flags=re.ASCII)
        write_controller(source, name, about, first_rad, controller.sample_time, fmi, path.absolute(), str(path))
        print(f"FMI {fmi}.0, co-simulation: r, theta_m and q3 in, u out; whole steps of {controller.sample_time:g} s")
    else:
        test = path.with_name(path.stem + "_test.c")
        for one, text in {path: source, test: c_test(controller, first_rad, path.name)}.items():
            with written(one.absolute(), "out", str(one), parents=False) as whole:
                whole.write_text(text, encoding="utf-8")
        what = "twin_step(&t, r, y)" if with_twin else "controller_step(&c, r, y)"
        print(f"one sample: {what}, with y = (measured angle rad, measured output m); in V")
        if with_twin:
            print("in the background: twin_estimate(&t)")
        print(shown_path(test))
    print(f"at most {c.limit_v:g} V (controller.limit_v)")
    print(shown_path(path))


def _form(own: dict[str, str], default: str) -> tuple[Path, int, bool]:
    """The file, the version of FMI, and whether the twin is in it, of the words beside the settings of a run.

    Raises
    ------
    UserError : one of these is not allowed, or not with the others.
    """
    path, fmi = Path(own.get("out", default)), own.get("fmi", "2")
    if path.suffix not in (C_SUFFIX, FMU_SUFFIX):
        raise UserError("out", str(path), f"must end in {C_SUFFIX} or {FMU_SUFFIX}")
    if fmi not in ("2", "3"):
        raise UserError("fmi", fmi, f"2 or 3, the version of FMI of a file that ends in {FMU_SUFFIX}")
    if "fmi" in own and path.suffix == C_SUFFIX:
        raise UserError("out", own.get("out", "(missing)"), f"must end in {FMU_SUFFIX} with fmi={fmi}")
    if own.get("with_twin", "false") not in ("true", "false"):
        raise UserError("with_twin", own["with_twin"], f"true or false; true with a file that ends in {C_SUFFIX}")
    with_twin = own.get("with_twin") == "true"
    if with_twin and path.suffix == FMU_SUFFIX:
        raise UserError("out", str(path), f"a file that ends in {C_SUFFIX} with with_twin=true")
    return path, int(fmi), with_twin


def _twin(config: RunConfig, belief: Belief, design: ControllerDesign) -> str:
    """The twin of a settled configuration as C."""
    from dtbacklash.experiment.sensors import roles
    from dtbacklash.twin.c99 import refuse, twin_source
    from dtbacklash.twin.gap.novelty import novelty_design
    from dtbacklash.twin.link.service import Twin

    refuse(config)
    output = list(belief.rig.sensors.values())[roles(belief.rig, True)[1]]
    twin = Twin.of(belief, output, config.twin, config.optimizer, config.sample_time_s)
    novelty = novelty_design(config.twin.novelty_filter, design.dominant_frequency_rad_s, config.sample_time_s)
    return twin_source(config, twin.model, novelty, twin.guard_settings())


def _export(words: Sequence[str]) -> None:
    from dtbacklash.commands.console import shown_path
    from dtbacklash.config.commands import ExportConfig
    from dtbacklash.config.compose import compose_for
    from dtbacklash.fmu import interface
    from dtbacklash.fmu.machine import write_machine
    from dtbacklash.physics.rig import build_rig

    config = compose_for(EXPORT, ExportConfig, *words)
    if config.rig.model:
        raise UserError("rig.model", config.rig.model, "is a simulator's model already: no FMU is made of it")
    rig = build_rig(config.rig)
    file = _target(config.out, interface.identifier(rig))
    write_machine(rig, config.sample_time_s, config.substeps, config.event_levels, config.fmi, file, config.out)
    offered = interface.variables(rig)
    for causality in (interface.INPUT, interface.OUTPUT, interface.PARAMETER):
        print(f"{causality + 's':<10} " + ", ".join(one.name for one in offered if one.causality == causality))
    print(f"FMI {config.fmi}.0, co-simulation; steps of whole multiples of {config.sample_time_s:g} s")
    print(shown_path(file))


def _target(out: str | None, name: str) -> Path:
    """Where the file goes: as chosen, else the rig's name here.

    Raises
    ------
    UserError : a name that is none of an FMU, a folder, a file in a folder that does not exist.
    """
    if out is None:
        return Path(name + FMU_SUFFIX).absolute()
    path = Path(out).expanduser()
    if path.is_dir():
        raise UserError("out", out, "is a folder; give a file name")
    if path.suffix != FMU_SUFFIX:
        raise UserError("out", out, f"must end in {FMU_SUFFIX}")
    if not path.absolute().parent.is_dir():
        raise UserError("out", out, "must lie in a folder that exists")
    return path.absolute()
