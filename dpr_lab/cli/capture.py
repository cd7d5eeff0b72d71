"""`dpr-lab capture`: guide, release, record and check."""

import select
import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import ArmMode, Elbow, InnerMode, Json, RigName, Rods, complete_pose, positive
from dpr_lab.cli.console import emit, line, say

if TYPE_CHECKING:
    from dpr_lab.acquisition.holding import Confirm
    from dpr_lab.acquisition.swing import Captured

DEGRADED = 6
"""Exit code if a run was recorded and kept but a check of the quality gate failed."""


def capture(
    rig: RigName,
    link: Annotated[
        str | None,
        typer.Option(
            help="Link to the device, e.g. serial:///dev/ttyACM0?baud=921600. Default: the link in the rig file."
        ),
    ] = None,
    pose: Annotated[
        list[str] | None,
        typer.Option(
            help="Pose of the release; may be repeated. Default: all poses of the rig file.",
            autocompletion=complete_pose,
        ),
    ] = None,
    duration: Annotated[
        float, typer.Option(callback=positive, help="Duration of the recording after the release, s.")
    ] = 10.0,
    until_rest: Annotated[
        bool, typer.Option("--until-rest", help="Record until both rods are at rest, at most 180 s.")
    ] = False,
    repeat: Annotated[int, typer.Option(min=1, help="Number of releases from each pose.")] = 1,
    rate_hz: Annotated[
        int | None, typer.Option(min=1, help="Sample rate, Hz. Default: the rate in the rig file.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Release as soon as the checks pass, without asking.")] = False,
    rods: Rods = None,
    elbow: Elbow = None,
    arm: ArmMode = None,
    inner: InnerMode = None,
    note: Annotated[str, typer.Option(help="Note to store in the run files.")] = "",
    out: Annotated[Path, typer.Option(help="Folder for the run files.")] = Path("runs"),
    as_json: Json = False,
) -> None:
    """Record free swings: one run file for each release.

    The rods are released only if they are at the pose and at rest, and the operator confirms the release with Enter.
    With --yes, no confirmation is required. Without a terminal nobody can confirm, so a real device requires --yes.

    Example: dpr-lab capture --rig paper --link sim:// --pose X1 --pose X2 --pose X3 --out runs
    """
    from dpr_lab.acquisition.capture import CaptureOptions
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.capture import capture as capture_runs

    options = CaptureOptions(rate_hz=rate_hz, duration=duration, until_rest=until_rest, note=note)
    confirm = release_question(ask=_must_confirm(rig, link, yes=yes))
    try:
        with Listener() as listener:
            captured = capture_runs(
                rig,
                out,
                options,
                confirm,
                poses=pose or (),
                repeat=repeat,
                url=link,
                rods=rods,
                elbow=elbow,
                arm=arm,
                inner=inner,
                on_event=listener,
            )
    except KeyboardInterrupt as stopped:
        reason = str(stopped) or "stopped by the operator: the rods were not released"
        raise KeyboardInterrupt(reason) from stopped
    if as_json:
        runs = [_record(run) for run in captured.captured]
        emit({"link": captured.url, "device": asdict(captured.device), "runs": runs})
    else:
        for file in captured.files:
            line(file)
    if not captured.ok:
        raise typer.Exit(DEGRADED)


def _must_confirm(rig: str, link: str | None, *, yes: bool) -> bool:
    """Return whether the operator has to confirm each release.

    Raises:
        LinkUrlError: the link is not valid, or of an unknown kind.
        BadParameter: a real device would be released, and without a terminal nobody can confirm it.
    """
    if yes or sys.stdin.isatty():
        return not yes
    from dpr_lab.rig import load_rig
    from dpr_lab.transports import known_link

    url = load_rig(rig).link.url if link is None else link
    if known_link(url).scheme != "sim":
        raise typer.BadParameter(
            f"{url}: without a terminal nobody can confirm the release with Enter; give --yes to release the rods as"
            " soon as the checks pass"
        )
    return False


def release_question(*, ask: bool) -> "Confirm":
    """Create a function that asks the operator to confirm the release with Enter, without blocking.

    The function returns True after an empty line that was typed after the question, False after any other line, and
    None while no line was typed. If `ask` is False, the function always returns True.
    """
    if not ask:
        return lambda: True
    waiting = False

    def confirm() -> bool | None:
        nonlocal waiting
        if not waiting:
            waiting = True
            _discard_typed()
            say("at the pose and at rest: press Enter to RELEASE, Ctrl-C to stop")
        if not select.select([sys.stdin], [], [], 0)[0]:
            return None
        waiting = False
        return {"": False, "\n": True}.get(sys.stdin.readline())

    return confirm


def _discard_typed() -> None:
    """Discard keys that were typed before the question, because they do not answer it."""
    with suppress(ImportError):  # termios does not exist on Windows
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)


def _record(captured: "Captured") -> dict[str, Any]:
    from dpr_lab.storage.inspect import info

    summary = asdict(info(captured.run_file))
    names = ("file", "pose", "samples", "duration_s", "release_tick", "lost", "pose_measured_rad", "sha256")
    return {name: summary[name] for name in names} | {
        "ok": captured.quality.ok,
        "verdict": captured.quality.to_json(),
    }
