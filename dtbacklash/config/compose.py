"""A checked configuration from override words, as the command line would make it; for scripts, tests and the paper."""

from dtbacklash.config.load import load
from dtbacklash.config.run import RunConfig


def compose(*overrides: str) -> RunConfig:
    """The configuration of ``dtb run <overrides>``.

    Raises
    ------
    UserError : a value out of range, an unknown key.
    """
    import hydra
    from hydra.core.global_hydra import GlobalHydra

    from dtbacklash.commands.hydra_app import plain_overrides, register

    register()
    GlobalHydra.instance().clear()
    with hydra.initialize_config_module("dtbacklash.conf", version_base="1.3"):
        return load(hydra.compose("run", overrides=plain_overrides(list(overrides))))
