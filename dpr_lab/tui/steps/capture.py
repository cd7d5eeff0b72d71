"""Step Capture: place the rods, release them, record, check."""

import random
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from textual.app import ComposeResult

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.acquisition.holding import HangReading
from dpr_lab.errors import ConfigError, DprError
from dpr_lab.report.run_names import run_name
from dpr_lab.rig import Rig, load_rig
from dpr_lab.shown import counted
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.recorder.attempt import Attempt, Phase
from dpr_lab.tui.recorder.messages import (
    AttemptFinished,
    AttemptSeen,
    CancelAttempt,
    CaptureAttempt,
    GoAhead,
    GoAheadAsked,
    RecorderFailed,
    RecorderReport,
)
from dpr_lab.tui.recorder.settings import SETTINGS
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.capture_choices import CHOICES
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.texts import following
from dpr_lab.tui.widgets.capture_view import CaptureState, CaptureView
from dpr_lab.tui.widgets.checklist import kept, next_pose, set_aside
from dpr_lab.tui.widgets.countdown import Countdown, new_code

BUSY = "An attempt is under way: end it with {capture.end}, or keep ({capture.keep}) or repeat ({capture.again}) it"
UNDECIDED = "Keep the recorded swing with {capture.keep}, or set it aside and repeat with {capture.again}"


class CaptureStep(Step):
    """Step that guides the operator through placement, release and recording."""

    NAME = "Capture"
    HELP = """
Record one free swing for each pose of the rig.

1. `{capture.start}` closes the latch and guides you: turn each rod until its mark is between the brackets.
2. Let the rods come to rest in the latch.
3. `{capture.release}` opens a dialog with a countdown; **any other key stops it**. The countdown begins when the
   terminal confirms that the dialog is displayed. If the terminal does not confirm a number within 0.3 s, nothing is
   released. At the end of the countdown the latch opens and the swing is recorded. In tmux, GNU screen, Zellij or
   mosh, first type the code that the dialog shows.
4. The recording is checked. `{capture.keep}` keeps it. `{capture.again}` moves it to `runs/aside` and starts the same
   pose again.

`{capture.end}` ends an attempt; the rods stay held, and the data recorded so far are kept. Only the countdown opens the
latch. `{capture.pose_up}` and `{capture.pose_down}` select the pose, `{capture.length}` the duration of the recording,
and `{capture.repeats}` the number of releases of each pose. `{capture.connect}` connects again after a loss of the
link. `{app.import}` imports a recording of another logger instead.

Grey values are outdated: no newer message has arrived from the device, and the latch may have opened meanwhile.
"""
    BINDINGS = bindings("capture")

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self.options = CaptureOptions(pose_timeout=CHOICES.pose_timeout, rest_timeout=CHOICES.rest_timeout)
        self.attempt: Attempt | None = None
        self._ended: Attempt | None = None
        self._rig: Rig | None = None
        self._pose = ""
        self._repeats = 1
        self._attempts = 0
        self._countdown: Countdown | None = None
        self._ordered = False
        self._chance = random.SystemRandom()

    def compose(self) -> ComposeResult:
        """Build the view of the capture."""
        yield CaptureView()

    def on_mount(self) -> None:
        """Read the rig of the workspace, and update outdated readings regularly.

        The step Rig reports errors of the rig file.
        """
        self.set_interval(SETTINGS.fresh_s / 3, self._age)
        with suppress(ConfigError):
            self._rig = load_rig(self.workspace.rig)

    def outcome(self) -> str:
        """Return the number of recorded runs as text."""
        count = len(self.workspace.runs)
        return counted(count, "run") if count else ""

    def missing(self) -> str:
        """Name the missing device, rig or pose; return an empty text if nothing is missing."""
        if self._rig is None:
            return f"Capture needs a rig file that can be read: press {self.services.key_of('Rig')} and choose one"
        if self.device.opening is not None:
            return "Capture needs a device: wait until the connection is complete"
        if self.device.connected is None:
            table = self.services.keys.key_for("app.import")
            connect = self.services.key_of("Connect")
            return f"Capture needs a device: press {connect} and connect one ({table} imports a table instead)"
        if not self._rig.poses:
            return f"The rig {self._rig.name} has no poses: add a table [poses.X1] to its file"
        return ""

    def at_stake(self) -> str:
        """Return a warning if quitting ends a recording, or leaves a recording without a decision.

        The text is empty if there is no such recording.
        """
        if self.attempt is not None and self.attempt.phase is Phase.RECORDING:
            return "The current recording ends now; the data recorded so far are kept."
        if self.workspace.undecided is None:
            return ""
        keep = self.services.keys.key_for("capture.keep")
        name = run_name(self.workspace.undecided)
        return (
            f"Nothing is lost: the file of {name} is kept, and the next session asks again ({keep} in"
            f" Capture keeps it)."
        )

    @property
    def urgent(self) -> str:
        """Countdown, or pose and time of the recording in progress."""
        attempt = self.attempt
        if self._countdown is not None:
            return "RELEASING"
        if attempt is None or attempt.phase is not Phase.RECORDING:
            return ""
        t = attempt.recorded.t if attempt.recorded is not None else 0.0
        duration = "" if self.options.until_rest else f" of {self.options.duration:g}"
        return f"● REC {attempt.name} {t:.0f}{duration} s"

    def enter(self) -> None:
        """Read the rig file again, because it may have changed."""
        self._rig = None
        self._rig = load_rig(self.workspace.rig)
        self._take_planned(self._rig)
        if self._pose not in self._rig.poses:
            self._pose = next(iter(self._rig.poses), "")
            self._pose = next_pose(self._done(), self._repeats, self._pose)
        self._draw()

    def _take_planned(self, rig: Rig) -> None:
        """Select pose and duration of the release that the operator chose in the step Plan."""
        if self.attempt is None and self.workspace.next_pose in rig.poses:
            self._pose, self.workspace.next_pose = self.workspace.next_pose, ""
            self.options = replace(self.options, until_rest=False, duration=self.workspace.next_duration_s)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether an action is available; Keep and Again need an undecided recording."""
        return action not in ("keep", "again") or self.workspace.undecided is not None

    def hear(self, report: RecorderReport) -> None:
        """Update the step by a report on the current attempt."""
        self._follow_order()
        match report:
            case RecorderFailed():
                self._failed(report)
            case AttemptSeen() | GoAheadAsked() | AttemptFinished():
                self._follow(report)
            case _:
                pass
        if (
            self.display and self._countdown is None
        ):  # the page behind a countdown is not redrawn, to keep the terminal line free
            self._draw()

    def _age(self) -> None:
        if self.display and self._countdown is None and not self.device.fresh(time.monotonic()):
            self._draw()

    def action_start(self) -> None:
        """Start an attempt at the selected pose."""
        self._require_none()
        if self.workspace.undecided is not None:
            raise DprError(self.worded(UNDECIDED))
        if self.missing() or self._rig is None:
            raise DprError(self.missing())
        self._attempts += 1
        self._ended = None
        self.app.clear_notifications()  # notices about the previous attempt
        self.attempt = Attempt(self._attempts, self._pose, self._rig.poses[self._pose])
        self.device.tell(CaptureAttempt(self._attempts, self._pose, self.options))
        self._draw()

    def action_release(self) -> None:
        """Count down, then send the release command.

        The release is refused unless the rods are at the pose and at rest.
        """
        attempt = self.attempt
        obstacle = self._obstacle()
        if attempt is None or obstacle:
            self.warn(f"Not released: {obstacle}")
            return
        keys = frozenset(
            key for key, active in self.screen.active_bindings.items() if active.binding.id == "capture.release"
        )
        self._countdown = Countdown(attempt.name, keys, self.services.sight, new_code(self._chance, keys))
        self._draw()
        self.app.push_screen(self._countdown, self._counted_down)

    def action_keep(self) -> None:
        """Add the recording to the workspace."""
        self._decided("keep", self.workspace.runs.append)
        self._pose = next_pose(self._done(), self._repeats, self._pose)
        self.changed()
        self._draw()

    def action_again(self) -> None:
        """Set the recording aside and repeat the pose."""
        self._decided("repeat", lambda run: self.notify(f"set aside: {set_aside(run)}"))
        self.changed()
        if self.missing():
            self._draw()
        else:
            self.action_start()

    def action_end(self) -> None:
        """End the current attempt; the rods stay held."""
        if self.attempt is None or self.attempt.phase is Phase.JUDGED:
            raise DprError("Nothing to end: there is no current attempt")
        self.device.tell(CancelAttempt(self.attempt.number))

    def action_pose(self, by: int) -> None:
        """Select the pose `by` positions further in the list."""
        self._require_none()
        if self._rig is not None and self._rig.poses:
            self._pose = following(list(self._rig.poses), self._pose, by)
            self._draw()

    def action_length(self) -> None:
        """Select the next longer duration; after the longest, recording until rest."""
        self._require_none()
        now = 0.0 if self.options.until_rest else self.options.duration
        longer = next((duration for duration in CHOICES.durations if duration > now), None)
        self.options = replace(self.options, until_rest=longer is None, duration=longer or now)
        self._draw()

    def action_repeats(self) -> None:
        """Increase the number of recordings per pose, from the maximum back to 1."""
        self._repeats = self._repeats % CHOICES.most_repeats + 1
        self._draw()

    async def action_connect(self) -> None:
        """Reconnect after the cable was unplugged."""
        if self.device.connected is not None:
            raise DprError(f"Already connected: {self.services.key_of('Connect')} shows this device and other links")
        if self.device.opening is None:
            self._ended = None
            await self.services.connect()
            self.changed()
            self._draw()

    def _require_none(self) -> None:
        """Check that no attempt is in progress; the settings of an attempt cannot be changed."""
        if self.attempt is not None:
            raise DprError(self.worded(BUSY))

    def _obstacle(self) -> str:
        """Return the reason why the rods must not be released now; empty if they may be released."""
        if self.attempt is None:
            return self.worded("press {capture.start} to be guided to the pose first")
        if not self.device.fresh(now := time.monotonic()):
            return f"no message from the device, {self.device.seen.ago(now)}"
        return self.attempt.obstacle

    def _counted_down(self, release: bool | None) -> None:
        countdown, self._countdown = self._countdown, None
        attempt, obstacle = self.attempt, self._obstacle()
        if not release or attempt is None:
            held = "nothing was released, the rods stay held"
            if not self.device.fresh(time.monotonic()):
                held = "no release was commanded, but the device is silent; state of the latch UNKNOWN: keep clear"
            reason = obstacle if countdown is None else countdown.why
            self.warn(f"Not released: {reason}; {held}")
        elif obstacle:
            self.warn(f"Not released: {obstacle}")
        else:
            self._ordered = True
            self.device.tell(GoAhead(attempt.number, attempt.name, time.monotonic()))
        self._draw()

    def _follow_order(self) -> None:
        """Warn the operator if the latch is still closed after a release command."""
        if self._ordered and self.device.ordered is None:
            self._ordered = False
            if self.device.seen.latched:
                held = "The release was not carried out: the latch is CLOSED, the rods are held"
                self.warn(held)

    def _follow(self, report: AttemptSeen | GoAheadAsked | AttemptFinished) -> None:
        attempt = self.attempt
        if attempt is None or report.attempt != attempt.number:
            return
        before = attempt.phase
        attempt.hear(report)
        if isinstance(report, GoAheadAsked) or (attempt.phase is Phase.RECORDING and attempt.phase is not before):
            self.app.bell()  # sound the bell, because the operator looks at the rods
        if self._countdown is not None and attempt.obstacle:
            self._countdown.stop(attempt.obstacle)
        if isinstance(report, AttemptFinished):
            self.workspace.undecided = report.captured.run_file
            self.changed()
        elif isinstance(report, AttemptSeen) and isinstance(report.progress, HangReading) and not report.progress.ok:
            errors = ", ".join(map(self.workspace.unit.text, report.progress.error))
            warning = (
                f"The hanging rods deviate by {errors} from the vertical: either the encoders lost counts, or the"
                " zero in the rig file is wrong"
            )
            self.notify(warning, severity="warning")

    def _failed(self, report: RecorderFailed) -> None:
        if report.attempt is not None or not report.alive:
            self.app.bell()
            if self._countdown is not None:
                self._countdown.stop(report.message)
            if self.attempt is not None and self.attempt.phase is not Phase.JUDGED:
                self._ended, self.attempt = self.attempt, None
        self.changed()

    def _decided(self, what: str, take: Callable[[Path], None]) -> None:
        """Pass the run that waits for a decision to the function `take`.

        This function keeps the run or sets it aside.

        Raises:
            DprError: no recording is finished; the message contains the verb `what`.
        """
        if self.workspace.undecided is None:
            raise DprError(f"Nothing to {what} yet: no recording is finished")
        take(self.workspace.undecided)
        self.workspace.undecided = self.attempt = None

    def _done(self) -> dict[str, int]:
        return kept(self.workspace.runs, self._rig.poses if self._rig is not None else ())

    def _draw(self) -> None:
        if self._rig is None or not self.is_mounted or not self.app.is_running:  # an app that ends removes widgets
            return
        now = time.monotonic()
        state = CaptureState(
            rig=self._rig,
            pose=self._pose,
            attempt=self.attempt,
            ended=self._ended,
            seen=self.device.seen,
            now=now,
            live=self.device.fresh(now),
            lost=self.device.lost is not None,
            ordered=self.device.ordered,
            countdown=self._countdown is not None,
            code=self._countdown is not None and self._countdown.waits_for_code,
            undecided=run_name(self.workspace.undecided) if self.workspace.undecided is not None else "",
            unit=self.workspace.unit,
            keys=self.services.keys,
            options=self.options,
            done=self._done(),
            repeats=self._repeats,
            obstacle=self.missing(),
        )
        self.query_one(CaptureView).show(state)
        self.refresh_bindings()
