"""What all pages share: the template engine, tables of contents, embedded images."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from dtbacklash.report.kit.numbers import fixed, number

#: a template that wants a table of contents has this line; it is made of the page's `<h2 id="...">`
CONTENTS = '<nav class="toc"></nav>'
HEADING = re.compile(r'<h2 id="([^"]+)">(.*?)</h2>', re.DOTALL)
#: a page with fewer sections needs none
SECTIONS_MIN = 4


def render(template: str, **values: Any) -> str:
    """Fill a template of `dtbacklash/report/templates`; every value is escaped for HTML.

    Where the template has the line `CONTENTS`, a table of the page's sections stands in the page.
    """
    environment = Environment(
        loader=PackageLoader("dtbacklash.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number=number, fixed=fixed, breakable=breakable, prose=prose)
    page = environment.get_template(template).render(**values)
    return page.replace(CONTENTS, _contents(page), 1)


def prose(text: str) -> Markup:
    """A sentence with what stands in back-ticks shown as a name."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def breakable(text: Any) -> str:
    """A text whose long names may be broken after an underscore, not before a number; what is missing is empty."""
    return "" if pd.isna(text) else re.sub("_(?=[a-z]{3})", "_\u200b", str(text))


def _contents(page: str) -> str:
    """Links to the sections of a page; nothing where there are few."""
    sections = HEADING.findall(page)
    if len(sections) < SECTIONS_MIN:
        return ""
    links = "\n".join(f'<a href="#{name}">{" ".join(title.split())}</a>' for name, title in sections)
    return f'<nav class="toc" aria-label="Contents">\n{links}\n</nav>'


@dataclass(frozen=True)
class Shown:
    """A figure as the macro `figure` of `parts.html.j2` shows it.

    `image` is a data URI, `good` a sentence on what to see in it, `title` stands in front of the caption.
    """

    image: str
    caption: str
    good: str = ""
    title: str = ""


def embedded(path: Path) -> str:
    """The PNG as a data URI, so that the page needs no other file."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
