"""Which code decides what is kept: all that a module imports, and nothing by hand."""

import re
import shutil

import grimp
import pytest

from dtbacklash import source_hash
from dtbacklash.prove import work


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph(source_hash.ROOT, exclude_type_checking_imports=True)


def modules(files):
    """The names of the modules that have code; an empty package is no more than its place."""
    parts = [file.relative_to(source_hash.PACKAGE.parent).with_suffix("").parts for file in files]
    return {".".join(one[:-1] if one[-1] == "__init__" else one) for one in parts}


@pytest.mark.parametrize(
    "module", ["prove.conceal", "prove.oracle", "diagnosis", "recording", "config.compose", "fmu.machine"]
)
def test_what_a_module_imports_is_what_the_graph_of_imports_says(graph, module):
    name = f"{source_hash.ROOT}.{module}"
    found, upstream = modules(source_hash.imported(name)), graph.find_upstream_modules(name) | {name}
    assert upstream - {source_hash.ROOT} <= found
    assert f"{source_hash.ROOT}.cli" not in found  # nothing imports it


@pytest.mark.parametrize("parts", [work.CONCEALED_BY, work.DIAGNOSED_BY, work.ORACLE_BY])
def test_a_number_that_is_changed_in_any_of_the_files_makes_other_code(tmp_path, monkeypatch, parts):
    """In each module with a number, wherever it is: the natural frequencies of a rig decide what is concealed."""
    copy = tmp_path / source_hash.ROOT
    shutil.copytree(source_hash.PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(source_hash, "PACKAGE", copy)

    def digest():
        source_hash._digest.cache_clear()
        return source_hash.digest(parts)

    before = digest()
    files = [file for part in parts if part.startswith(source_hash.ROOT) for file in source_hash.imported(part)]
    assert copy / "physics" / "bodies.py" in files
    changed = 0
    for file in dict.fromkeys(files):
        text = file.read_text(encoding="utf-8")
        other = re.sub(r"\b[1-9]\d*\b", "7777", text, count=1)
        if other != text:
            file.write_text(other, encoding="utf-8")
            assert digest() != before, file
            file.write_text(text, encoding="utf-8")
            changed += 1
    assert changed > len(set(files)) / 2
    assert digest() == before
    source_hash._digest.cache_clear()


def test_settings_that_are_read_count():
    for parts in (work.CONCEALED_BY, work.DIAGNOSED_BY):
        for data in ("conf/rig", "physics/laws"):
            assert data in parts
            assert source_hash.digest((data,)) != source_hash.digest((f"{data}_of_nobody",))
