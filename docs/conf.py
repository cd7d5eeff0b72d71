"""The site of the documentation: `make docs`."""

import io
import os
from contextlib import redirect_stdout
from pathlib import Path
from unittest.mock import patch

from sphinx.application import Sphinx
from typer.core import TyperGroup

from dpr_lab.version import __version__

HERE = Path(__file__).parent

project = "dpr-lab"
copyright = "the dpr-lab contributors"
version = release = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "myst-nb"}
exclude_patterns = ["decisions/README.md", "examples/plugin", "package.md"]
html_theme = "furo"
html_title = f"dpr-lab {version}"
html_copy_source = False
html_show_sphinx = False
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 900
nb_ipywidgets_js = {}
autodoc_typehints = "description"
autodoc_member_order = "bysource"
nitpicky = False


def help_of(words: list[str]) -> str:
    """Output of `dpr-lab WORDS --help` on a terminal of 100 columns, written in this process."""
    from dpr_lab.cli.app import app as commands

    with redirect_stdout(io.StringIO()) as stdout:
        code = commands([*words, "--help"], prog_name="dpr-lab", standalone_mode=False)
    assert not code, f"dpr-lab {' '.join(words)} --help: exit code {code}"
    return stdout.getvalue().strip()


@patch.dict(os.environ, {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"})
def write_command_line(app: Sphinx) -> None:
    """Every command's own help, as `reference/command-line.md`."""
    from typer.main import get_command

    from dpr_lab.cli.app import app as commands

    group = get_command(commands)
    assert isinstance(group, TyperGroup)
    names = [[]]
    for name, command in group.commands.items():
        if command.hidden:
            continue
        inner = getattr(command, "commands", {}).items()
        names += [[name], *([name, sub] for sub, part in inner if not (part.help or "").startswith("Alias of"))]
    parts = ["# Command line\n\nOutput of `--help` for each command.\n"]
    for words in names:
        title = " ".join(["dpr-lab", *words])
        parts.append(f"## `{title}`\n\n```text\n{help_of(words)}\n```\n")
    target = HERE / "reference" / "command-line.md"
    text = "\n".join(parts)
    if not target.exists() or target.read_text(encoding="utf-8") != text:
        target.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Hooks of the build."""
    app.connect("builder-inited", write_command_line)
