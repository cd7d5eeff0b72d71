"""Render XML documents from the Jinja2 templates of this package; texts from files are escaped."""

import re
from functools import cache
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

if TYPE_CHECKING:
    from jinja2 import Environment

_NO_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
"""Pattern of characters that XML 1.0 cannot contain, even escaped."""
_IN_ATTRIBUTES = {'"': "&quot;", "\t": "&#9;", "\n": "&#10;", "\r": "&#13;"}
"""Further characters that are escaped. In an attribute, a parser would end the text at a quotation mark, and replace
the other characters by blanks."""


def rendered(template: str, **values: Any) -> str:
    """Render a template with the given values; texts are escaped.

    Args:
        template: name of a file in the folder `templates`
        values: variables of the template
    """
    return _environment().get_template(template).render(values) + "\n"


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # not needed for other exports
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("dpr_lab.exports"),
        autoescape=True,
        finalize=lambda value: Markup(escape(_in_xml(value), _IN_ATTRIBUTES)) if type(value) is str else value,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["comment"] = lambda text: Markup(_in_xml(text).replace("-", "\N{NON-BREAKING HYPHEN}"))
    return environment


def _in_xml(text: str) -> str:
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)
