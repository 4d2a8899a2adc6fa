"""A checked configuration from override words, as the command line would make it; for Python, tests and the paper."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from functools import lru_cache
from threading import RLock
from typing import Any, TypeVar

from omegaconf import DictConfig

from dtbacklash.config.grammar import RUN, Grammar
from dtbacklash.config.groups import FOLDERS, PACKAGED, has_own
from dtbacklash.config.load import load
from dtbacklash.config.run import RunConfig

Config = TypeVar("Config")

_one_at_a_time = RLock()


def compose(*overrides: str, rig: Mapping[str, Any] | None = None, model: Mapping[str, Any] | None = None) -> RunConfig:
    """The configuration of ``dtb run <overrides>``; Hydra's state in this process stays as it was.

    overrides : words as on the command line, e.g. ``"controller=imc"``.
    rig : the content of a rig's YAML file, in place of ``rig=NAME``; overrides such as ``rig.parameters.k.value=9000``
        change it. model : the same in place of ``model=NAME``.

    Raises UserError: a value out of range, an unknown key or choice, a word that is none.
    """
    return compose_for(RUN, RunConfig, *overrides, rig=rig, model=model)


def compose_for(grammar: Grammar, schema: type[Config], *overrides: str, **given: Mapping[str, Any] | None) -> Config:
    """The configuration of any command; ``schema`` is that of its grammar. The rest as for :func:`compose`.

    given : group -> the content of its option's file.
    """
    from dtbacklash.config.explain import explain

    words = list(overrides)
    try:
        with _hydra_apart(), _options(given) as choices:
            return load(_composed(grammar, [*choices, *words]), schema)
    except Exception as error:
        mistake = explain(error, words, grammar)
        if mistake is None:
            raise
        raise mistake from error


def _composed(grammar: Grammar, words: list[str]) -> DictConfig:
    """Hydra's configuration. The options of the package are composed once; values go into a copy of them."""
    from hydra._internal.config_loader_impl import ConfigLoaderImpl
    from hydra.core.override_parser.overrides_parser import OverridesParser

    from dtbacklash.config.hydra_app import overrides, register

    register()
    asked = overrides(grammar, words)
    parsed = OverridesParser.create().parse_overrides(asked)
    folders = [PACKAGED / FOLDERS.get(one.key_or_group, one.key_or_group) for one in parsed]
    options = [one for one, folder in zip(parsed, folders, strict=True) if folder.is_dir()]
    files = [f / f"{one.value()}.yaml" for one, f in zip(parsed, folders, strict=True) if f.is_dir()]
    other = any(one.package or one.is_sweep_override() or one.key_or_group.startswith("hydra") for one in parsed)
    if has_own() or other or not all(file.is_file() for file in files):
        return _by_hydra.__wrapped__(grammar.name, tuple(asked))
    config = deepcopy(_by_hydra(grammar.name, tuple(sorted(str(one.input_line) for one in options))))
    ConfigLoaderImpl._apply_overrides_to_config([one for one in parsed if one not in options], config)
    return config


@lru_cache(maxsize=64)
def _by_hydra(name: str, words: tuple[str, ...]) -> DictConfig:
    import hydra

    from dtbacklash.config.hydra_app import VERSION_BASE

    with hydra.initialize_config_module("dtbacklash.conf", version_base=VERSION_BASE):
        return hydra.compose(name, overrides=list(words))


@contextmanager
def _options(given: Mapping[str, Mapping[str, Any] | None]) -> Iterator[list[str]]:
    """Offer rigs that are no files as options of their groups, and give the words that choose them."""
    from hydra.core.config_store import ConfigStore

    name, store = "_given", ConfigStore.instance()
    offered = {group: content for group, content in given.items() if content is not None}
    for group, content in offered.items():
        store.store(name=name, group=group, node=dict(content))
    try:
        yield [f"{group}={name}" for group in offered]
    finally:
        for group in offered:
            store.repo.get(group, {}).pop(f"{name}.yaml", None)


@contextmanager
def _hydra_apart() -> Iterator[None]:
    """Put aside what Hydra keeps for the process, and give it back: the caller may be an application of Hydra itself.

    Hydra initializes one application a process, remembers its name and version, and replaces resolvers of OmegaConf.
    """
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.singleton import Singleton
    from hydra.core.utils import JobRuntime
    from hydra.version import VersionBase
    from omegaconf.basecontainer import BaseContainer

    kinds: tuple[type, ...] = (GlobalHydra, JobRuntime, VersionBase)
    with _one_at_a_time:
        aside = {kind: Singleton._instances.pop(kind) for kind in kinds if kind in Singleton._instances}
        resolvers = dict(BaseContainer._resolvers)
        try:
            yield
        finally:
            for kind in kinds:
                Singleton._instances.pop(kind, None)
            Singleton._instances.update(aside)
            BaseContainer._resolvers.clear()
            BaseContainer._resolvers.update(resolvers)
