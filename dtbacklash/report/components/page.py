"""Blocks as a page: the template engine, names in texts, embedded images."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from dtbacklash.report.components.blocks import Part

TEMPLATE, PARTS = "page.html.j2", "parts.html.j2"
#: what the pages cite, each once
PAPER = "“The use of a digital twin to reconfigure a nonlinear internal model controller”"
INTEGRATOR = "Cox and Matthews, J. Comput. Phys. 176 (2002) 430"
SHARES = "Wilson, J. Am. Stat. Assoc. 22 (1927) 209; Newcombe, Statistics in Medicine 17 (1998) 857"
#: how a cell of a few words looks with one of these in it
MOODS = {
    "bad": {"fail", "miss", "failed", "rejected", "not"}, "good": {"pass", "sure", "done", "accepted"},
}  # fmt: skip


def render(title: str, lead: str, parts: Sequence[Part], badges: Sequence[tuple[str, str]] = ()) -> str:
    """A page of blocks; every text is escaped for HTML.

    title: of the page, in one sentence what came out.
    lead: a line below it.
    parts: see :mod:`.blocks`.
    badges: (text, class ``good``, ``fair``, ``warm`` or ``bad``) above the title.
    """
    return _environment().get_template(TEMPLATE).render(title=title, lead=lead, parts=parts, badges=badges)


def fragment(*parts: Part) -> str:
    """Blocks as HTML without a page around them, for a notebook."""
    return _environment().get_template(PARTS).render(parts=parts)


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("dtbacklash.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters.update(prose=prose, mood=mood)
    return environment


def prose(text: Any) -> Markup:
    """A text with what stands in back-ticks shown as a name; markup stays as it is, what is missing is empty."""
    if isinstance(text, Markup):
        return text
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", "" if pd.isna(text) else str(escape(text))))


def mood(cell: Any) -> str:
    """The class of a cell that says what is good or bad, in a few words; empty of any other."""
    words = str(cell).split()
    if words[:1] == ["open"]:
        return "warm"
    return "" if len(words) > 3 else next((look for look, known in MOODS.items() if known & set(words)), "")


def embedded(content: Path | bytes) -> str:
    """A PNG as a data URI, so that the page needs no other file."""
    data = content.read_bytes() if isinstance(content, Path) else content
    return "data:image/png;base64," + base64.b64encode(data).decode("ascii")
