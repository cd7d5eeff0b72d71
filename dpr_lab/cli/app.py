"""The table of commands."""

import os

import typer

from dpr_lab.cli import effects, rigs, runs, trials
from dpr_lab.cli.accept import accept
from dpr_lab.cli.capture import capture
from dpr_lab.cli.certify import certify, verify
from dpr_lab.cli.check import check
from dpr_lab.cli.compare import compare
from dpr_lab.cli.conform import conform
from dpr_lab.cli.demo import demo
from dpr_lab.cli.diagnose import diagnose
from dpr_lab.cli.doctor import doctor
from dpr_lab.cli.drift import drift
from dpr_lab.cli.export import export
from dpr_lab.cli.identifiability import identifiability
from dpr_lab.cli.identify import identify
from dpr_lab.cli.import_table import import_app
from dpr_lab.cli.listing import Listing
from dpr_lab.cli.paper import paper
from dpr_lab.cli.plan import plan
from dpr_lab.cli.schema import schema
from dpr_lab.cli.serve import serve
from dpr_lab.cli.tui import tui
from dpr_lab.plugins.installed import OFF
from dpr_lab.version import __version__

HELP = """Identify a rotary double pendulum and explain why its simulation differs from the rig.

\b
Example:
  dpr-lab demo --out out/demo
  dpr-lab capture --rig paper --pose X1 --pose X2 --pose X3 --out runs
  dpr-lab identify runs/*.mcap --rig paper --out model.json
  dpr-lab compare runs/*.mcap --model model.json --out report

\b
Exit codes:
  0 ok                        5 protocol mismatch
  1 refused by a check        6 degraded capture (file kept)
  2 usage                     7 device lost (partial file kept)
  3 configuration or input    8 identification failed its own checks
  4 device not found or busy  9 limits not decidable with these runs
                              130 interrupted (file finalised)
"""

app = typer.Typer(help=HELP, cls=Listing, no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False)


def _version(show: bool) -> None:
    if show:
        print(f"dpr-lab {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Show the version."),
    no_plugins: bool = typer.Option(
        False,
        "--no-plugins",
        help="Load no plugins of other packages. Write this option before the command, or set DPR_LAB_NO_PLUGINS=1.",
    ),
) -> None:
    if no_plugins:
        os.environ[OFF] = "1"  # also for the processes that the command starts


for command in (
    demo,
    tui,
    capture,
    identify,
    identifiability,
    compare,
    diagnose,
    check,
    certify,
    verify,
    drift,
    accept,
    plan,
    export,
    paper,
    schema,
    serve,
    doctor,
    conform,
):
    app.command()(command)
app.add_typer(effects.app, name="effects")
app.add_typer(import_app, name="import")
app.add_typer(rigs.app, name="rig")
app.add_typer(runs.app, name="run")
app.add_typer(trials.app, name="trials")
