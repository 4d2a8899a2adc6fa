"""How heavy the tree is, held against ``ratchet.yaml``: ``python tests/ratchet.py [--lower]``.

A number that somebody chose is one in a constant of a module or a class, or in a default of an argument, other than 0,
1, 2, 1/2 and their negatives. The laws of physics are what they are: numbers in ``physics/effects`` do not count.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
FILE = Path(__file__).with_suffix(".yaml")
#: written when the package is built
GENERATED = "_declared.py"
PLAIN = {0.0, 0.5, 1.0, 2.0}


def chosen_numbers(source: str) -> int:
    """How many numbers somebody chose in a module."""
    values: list[ast.AST] = []
    for node in _statements(ast.parse(source)):
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            values.append(node.value)
        if isinstance(node, ast.FunctionDef):
            values += [*node.args.defaults, *(one for one in node.args.kw_defaults if one is not None)]
    constants = [one.value for value in values for one in ast.walk(value) if isinstance(one, ast.Constant)]
    return sum(type(one) in (int, float) and one not in PLAIN for one in constants)


def _statements(body: ast.Module | ast.ClassDef) -> Iterator[ast.stmt]:
    for node in body.body:
        yield node
        if isinstance(node, ast.ClassDef):
            yield from _statements(node)


def weigh(root: Path) -> dict[str, int]:
    """The figures of a tree, by their names in ``ratchet.yaml``."""
    texts = {
        folder: {
            path: path.read_text(encoding="utf-8")
            for path in sorted((root / folder).rglob("*.py"))
            if path.name != GENERATED
        }
        for folder in ("dtbacklash", "hydra_plugins", "tests", "studies")
    }
    lines = {folder: sum(text.count("\n") for text in found.values()) for folder, found in texts.items()}
    package = texts["dtbacklash"] | texts["hydra_plugins"]
    laws = root / "dtbacklash" / "physics" / "effects"
    return {
        "package": lines["dtbacklash"] + lines["hydra_plugins"], "files": len(package), "tests": lines["tests"],
        "studies": lines["studies"],
        "chosen numbers": sum(chosen_numbers(text) for path, text in package.items() if laws not in path.parents),
    }  # fmt: skip


def main(lower: bool) -> int:
    """Print what is exceeded, or take down what has become less; returns the exit code."""
    text = FILE.read_text(encoding="utf-8")
    most = {name: int(one["most"]) for name, one in yaml.safe_load(text).items()}
    found = weigh(ROOT)
    if lower:
        for name, value in found.items():
            text = re.sub(
                rf"^{name}: {{most: \d+", f"{name}: {{most: {min(value, most[name])}", text, flags=re.MULTILINE
            )
        FILE.write_text(text, encoding="utf-8")
    over = [f"{name}: {value}, at most {most[name]}" for name, value in found.items() if value > most[name]]
    for line in over:
        print(f"too heavy: {line}; make it lighter, or raise it in {FILE.relative_to(ROOT)} with the reason")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main("--lower" in sys.argv[1:]))
