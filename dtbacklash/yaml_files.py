"""YAML that users write: rigs, mappings of recordings. Read without running anything, and never longer than a moment.

A file is data: no interpolation is resolved (``${oc.env:HOME}`` would carry the environment into reports), no tag makes
an object, and aliases may not blow a small file up (nine lines of nine aliases each stand for 9⁹ values).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import yaml

SIZE_MAX = 4 << 20  # bytes of a file
DEPTH_MAX = 40  # of mappings and lists in one another
VALUES_MAX = 100_000  # with every alias written out
NUMBER_MAX = 10**300
INTERPOLATION = "${"

_RESOLVER = re.compile(r"\$\{.*:", re.DOTALL)
#: numbers as in YAML 1.2 and in the settings of the command line: 1e-3 is one
_FLOAT = re.compile(
    r"""^(?:[-+]?[0-9][0-9_]*\.[0-9_]*(?:[eE][-+]?[0-9]+)?|[-+]?[0-9][0-9_]*[eE][-+]?[0-9]+
    |[-+]?\.[0-9][0-9_]*(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$""",
    re.VERBOSE,
)


class Mistake(ValueError):
    """A file that cannot be used; its text is one phrase that says why and where."""


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
    """PyYAML's safe loader with numbers as people write them, no dates, and no key given twice."""

    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {
        sign: [(tag, pattern) for tag, pattern in known if not tag.endswith((":timestamp", ":float"))]
        for sign, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise Mistake(f"is not valid here: a key must be a word{_where(key)}")
            if key.tag != "tag:yaml.org,2002:merge" and key.value in seen:
                raise Mistake(f"gives the key {key.value} twice{_where(key)}")
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))


def read(content: bytes | str) -> Any:
    """The content of a user's YAML file as dictionaries, lists, texts and numbers.

    Raises
    ------
    Mistake : not text, not YAML, too large, too deep, too many values once aliases are written out, a key twice, a
        tag that would make an object, or an interpolation.
    """
    with _text(content) as text:
        _check_events(text)
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            _check_size(node)
            data = loader.construct_document(node) if node is not None else None
        finally:
            loader.dispose()
    _check_values(data)
    return data


def check(content: bytes, resolvers: bool = False) -> None:
    """Check a file that another reader will load: as :func:`read`, but references to other settings are allowed.

    ``resolvers`` : whether interpolations that call one (``${oc.env:HOME}``) are allowed as well.

    Raises
    ------
    Mistake : see :func:`read`.
    """
    with _text(content) as text:
        _check_events(text, resolvers)
        _check_size(yaml.compose(text, Loader=_Loader))


@contextmanager
def _text(content: bytes | str) -> Iterator[str]:
    """The text of a file; what goes wrong while it is read, here and in the block, becomes a Mistake."""
    if len(content) > SIZE_MAX:
        raise Mistake(f"is too large: {len(content) / 1e6:.0f} MB, at most {SIZE_MAX >> 20} MB")
    try:
        yield content.decode("utf-8-sig") if isinstance(content, bytes) else content
    except UnicodeDecodeError as error:
        raise Mistake("must be text in UTF-8") from error
    except yaml.YAMLError as error:
        raise Mistake(_problem(error)) from error
    except Mistake:
        raise
    except ValueError as error:  # a number of ten thousand digits
        raise Mistake(f"holds a value that cannot be read ({str(error).splitlines()[0][:60]})") from error


def _check_values(data: Any, key: str = "") -> None:
    """Refuse ``${...}`` and endless numbers anywhere in what a file holds (raises Mistake that names the key)."""
    if isinstance(data, dict):
        for name, value in data.items():
            _check_values(name, key)
            _check_values(value, f"{key}.{name}" if key else str(name))
    elif isinstance(data, list):
        for value in data:
            _check_values(value, key)
    elif isinstance(data, int) and abs(data) > NUMBER_MAX:
        raise Mistake(f"holds a whole number of more than 300 digits at {key or 'its top'}")
    elif data is not None and not isinstance(data, (str, int, float)):
        raise Mistake(f"holds a {type(data).__name__} at {key or 'its top'}; write numbers, texts, lists and mappings")
    elif isinstance(data, str) and INTERPOLATION in data:
        raise Mistake(f"holds {data[:60]!r} at {key or 'its top'}; ${{...}} is not resolved in a file, write the value")


def _check_events(text: str, resolvers: bool = False) -> None:
    """Walk through the file without building anything: depth, length, resolvers."""
    depth = 0
    for count, event in enumerate(yaml.parse(text, Loader=yaml.SafeLoader)):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > DEPTH_MAX:
                raise Mistake(f"is nested more than {DEPTH_MAX} deep{_where(event)}")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif not resolvers and isinstance(event, yaml.ScalarEvent) and _RESOLVER.search(event.value):
            raise Mistake(
                f"holds {event.value[:60]!r}{_where(event)}; ${{...}} is not resolved in a file, write the value"
            )
        if count > 2 * VALUES_MAX:
            raise Mistake(f"holds more than {VALUES_MAX} values")


def _check_size(node: Any) -> None:
    """Count the values that a graph of nodes stands for, each node once, as deep as it goes with aliases."""
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()

    def size(node: Any, depth: int) -> int:
        mark = id(node)
        if mark in open_nodes:
            raise Mistake(f"holds an alias of something that it is part of{_where(node)}")
        if depth > DEPTH_MAX:
            raise Mistake(f"is nested more than {DEPTH_MAX} deep{_where(node)}")
        if mark in sizes or isinstance(node, yaml.ScalarNode):
            return sizes.get(mark, 1)
        open_nodes.add(mark)
        pairs = isinstance(node, yaml.MappingNode)
        if pairs:
            _check_commas(node)
        parts = [part for pair in node.value for part in pair] if pairs else node.value
        sizes[mark] = 1 + sum(size(part, depth + 1) for part in parts)
        open_nodes.remove(mark)
        if sizes[mark] > VALUES_MAX:
            raise Mistake(f"stands for more than {VALUES_MAX} values: too many aliases (*name)")
        return sizes[mark]

    if node is not None:
        size(node, 0)


def _check_commas(node: Any) -> None:
    """Refuse ``{value: 1,2 ohm}``, which YAML reads as a value of 1 and a key ``2 ohm`` without one."""
    for (name, value), (key, nothing) in pairwise(node.value):
        whole = isinstance(value, yaml.ScalarNode) and re.fullmatch(r"[-+]?\d+", value.value)
        bare = isinstance(nothing, yaml.ScalarNode) and nothing.value == "" and isinstance(key, yaml.ScalarNode)
        if whole and bare and re.match(r"\d", key.value):
            said = f"{name.value}: {value.value},{key.value}"
            raise Mistake(f"holds a decimal comma in {said!r}{_where(key)}; write {value.value}.{key.value}")


def _problem(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or next(iter(str(error).splitlines()), "not readable")
    return f"is not valid YAML: {problem}" + (f" (line {mark.line + 1})" if mark is not None else "")


def _where(node: Any) -> str:
    mark = getattr(node, "start_mark", None)
    return f" (line {mark.line + 1})" if mark is not None else ""


def rig_content(content: Any, file: Path | None = None) -> Any:
    """The content of a rig's file in its long form: ``k: 3 N/m`` is ``k: {value: 3 N/m}``, and paths are absolute.

    file : where it stands; the path of a simulator's model counts from there. Raises Mistake: a list or a truth value.
    """
    if not isinstance(content, dict):
        return content
    if file is not None and isinstance(model := content.get("model"), str) and model:
        content["model"] = str((file.parent / Path(model).expanduser()).resolve())
    if isinstance(parameters := content.get("parameters"), dict):
        if (odd := next((name for name, one in parameters.items() if isinstance(one, (list, bool))), None)) is not None:
            raise Mistake(f"must give parameters.{odd} as a number, a text with a unit, or a mapping")
        content["parameters"] = {
            name: {"value": given} if isinstance(given, (str, int, float)) else given
            for name, given in parameters.items()
        }
    return content
