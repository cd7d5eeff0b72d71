"""`dpr-lab tui`: the bench screen."""

import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import complete_rig
from dpr_lab.errors import DprError


def tui(
    rig: Annotated[
        str | None,
        typer.Option(
            help="Rig file, or the name of a built-in one; when left out, the last one.", autocompletion=complete_rig
        ),
    ] = None,
    link: Annotated[
        str | None, typer.Option(help="Where the device is; when left out, the last one, or the rig file's.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of runs, model, report and diagnosis; or the last one.")
    ] = None,
    allow_release: Annotated[
        bool,
        typer.Option(
            "--allow-release",
            help="In a browser: whoever has the address may command the device, open the latch and write files.",
        ),
    ] = False,
    serve: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65535,
            metavar="PORT",
            help="Show it to browsers on this computer, read-only; prints the address to open, which holds a token.",
        ),
    ] = None,
) -> None:
    """Open the screen: connect, capture, identify, compare and diagnose.

    The screen comes back as it was left; F1 explains each step.

    Example: dpr-lab tui --rig paper --link sim:// --out bench
    """
    if serve is not None:
        from dpr_lab.tui.web import serve as serve_page

        given = (("--rig", rig), ("--link", link), ("--out", out and out.expanduser()))
        options = [word for name, value in given if value for word in (name, str(value))]
        allowed = ["--allow-release"] if allow_release else []
        serve_page([sys.executable, "-m", "dpr_lab", "tui", *options, *allowed], serve)
        return
    try:
        import_module("termios")
    except ModuleNotFoundError as missing:
        message = (
            "the bench screen runs on Linux and macOS, and in WSL on Windows; here use capture, identify and diagnose"
        )
        raise DprError(message) from missing
    served = "web_driver" in os.environ.get("TEXTUAL_DRIVER", "")
    if not sys.stdout.isatty() and not served:
        raise DprError("the bench screen needs a terminal; without one use capture, identify, compare and diagnose")
    from dpr_lab.tui import FRAMES_PER_S

    if served:
        os.environ["TEXTUAL_FPS"] = str(FRAMES_PER_S)  # what serves it asks for five times as many
    os.environ.setdefault("TEXTUAL_FPS", str(FRAMES_PER_S))
    from dpr_lab.tui.app import KEYED, DprApp
    from dpr_lab.tui.keys import keys_file, load_keymap
    from dpr_lab.tui.read_only import forbid_writing
    from dpr_lab.tui.workspace import load, state_folder

    keymap = load_keymap(keys_file(), DprApp, KEYED)
    workspace, notices = load(state_folder())
    workspace.rig, workspace.link = rig or workspace.rig, link or workspace.link
    workspace.out = (out or workspace.out).expanduser().resolve()
    read_only = served and not allow_release
    app = DprApp(workspace, state_folder(), keymap, notices, allow_release=allow_release, read_only=read_only)
    if read_only:
        forbid_writing()
    app.run()
    if app.return_code:
        raise typer.Exit(app.return_code)
