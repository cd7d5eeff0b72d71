"""`dpr-lab tui`: the screen, a terminal user interface."""

import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import complete_rig
from dpr_lab.errors import DprError, UnexpectedError


def tui(
    rig: Annotated[
        str | None,
        typer.Option(
            help="Rig file, or name of a built-in rig. Default: the rig of the last session.",
            autocompletion=complete_rig,
        ),
    ] = None,
    link: Annotated[
        str | None, typer.Option(help="Link to the device. Default: the link of the last session, or of the rig file.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for runs, model, report and diagnosis. Default: the folder of the last session. In a"
            " new folder, no runs and no results are selected."
        ),
    ] = None,
    allow_release: Annotated[
        bool,
        typer.Option(
            "--allow-release",
            help=(
                "With --serve: allow control of the rig. Anyone who has the address can then send commands to the"
                " device, open the latch and write files."
            ),
        ),
    ] = False,
    serve: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65535,
            metavar="PORT",
            help="Serve the screen to browsers on this computer, read-only by default. The command prints the"
            " address, which contains a token.",
        ),
    ] = None,
) -> None:
    """Open the screen, a terminal user interface for all steps from the connection to the plan.

    The screen restores the last session. F1 explains each step.

    Example: dpr-lab tui --rig paper --link sim:// --out bench
    """
    if serve is not None:
        from dpr_lab.tui.web import serve as serve_page

        arguments = (("--rig", rig), ("--link", link), ("--out", out and out.expanduser()))
        options = [word for name, value in arguments if value for word in (name, str(value))]
        allowed = ["--allow-release"] if allow_release else []
        serve_page([sys.executable, "-m", "dpr_lab", "tui", *options, *allowed], serve)
        return
    try:
        import_module("termios")
    except ModuleNotFoundError as missing:
        message = (
            "the screen requires Linux, macOS, or WSL on Windows; on this system use the commands capture,"
            " identify and diagnose"
        )
        raise DprError(message) from missing
    served = "web_driver" in os.environ.get("TEXTUAL_DRIVER", "")
    if not sys.stdout.isatty() and not served:
        raise DprError(
            "the screen needs a terminal; without a terminal use the commands capture, identify, compare and diagnose"
        )
    from dpr_lab.tui import FRAMES_PER_S

    if served:
        os.environ["TEXTUAL_FPS"] = str(FRAMES_PER_S)  # otherwise the server would request five times as many frames
    os.environ.setdefault("TEXTUAL_FPS", str(FRAMES_PER_S))
    from dpr_lab.tui.app import KEYED, DprApp
    from dpr_lab.tui.keys import keys_file, load_keymap
    from dpr_lab.tui.read_only import forbid_writing
    from dpr_lab.tui.workspace import load, state_folder

    keymap = load_keymap(keys_file(), DprApp, KEYED)
    workspace, notices = load(state_folder())
    workspace.rig, workspace.link = rig or workspace.rig, link or workspace.link
    workspace.move_to((out or workspace.out).expanduser().resolve())
    read_only = served and not allow_release
    app = DprApp(workspace, state_folder(), keymap, notices, allow_release=allow_release, read_only=read_only)
    if read_only:
        forbid_writing()
    app.run()
    if app.return_code:
        raise typer.Exit(UnexpectedError.exit_code if app.return_code == 1 else app.return_code)
