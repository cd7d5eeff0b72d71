"""`dpr-lab tui`: the bench screen."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.errors import DprError


def tui(
    rig: Annotated[str | None, typer.Option(help="Rig file, or the name of a built-in one; the last one's.")] = None,
    link: Annotated[str | None, typer.Option(help="Where the device is; the last one, or the rig file's.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of runs, model, report and diagnosis; the last one.")] = None,
) -> None:
    """Work at the rig on one screen: connect, capture, identify, compare, diagnose.

    The screen comes back as it was left; F1 explains each step.

    Example: dpr-lab tui --rig paper --link sim:// --out bench
    """
    if not sys.stdout.isatty():
        raise DprError("the bench screen needs a terminal; without one use capture, identify, compare and diagnose")
    from dpr_lab.tui import FRAMES_PER_S

    os.environ.setdefault("TEXTUAL_FPS", str(FRAMES_PER_S))
    from dpr_lab.tui.app import KEYED, DprApp
    from dpr_lab.tui.bench import load, state_folder
    from dpr_lab.tui.keys import keys_file, load_keymap

    keymap = load_keymap(keys_file(), DprApp, KEYED)
    bench, notices = load(state_folder())
    bench.rig, bench.link = rig or bench.rig, link or bench.link
    bench.out = (out or bench.out).resolve()
    DprApp(bench, state_folder(), keymap, notices).run()
