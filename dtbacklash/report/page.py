"""What both pages share: the template engine, embedded images, whole files only."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from dtbacklash.report.numbers import fixed, number


def render(template: str, **values: Any) -> str:
    """Fill a template of `dtbacklash/report/templates`; every value is escaped for HTML."""
    environment = Environment(
        loader=PackageLoader("dtbacklash.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number=number, fixed=fixed)
    return environment.get_template(template).render(**values)


def embedded(path: Path) -> str:
    """The PNG as a data URI, so that the page needs no other file."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
