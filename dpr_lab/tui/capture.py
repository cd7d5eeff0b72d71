"""Step 3: place the rods, let them go, record, judge."""

import math
import time
from contextlib import suppress
from dataclasses import replace
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType

from dpr_lab.capture import Captured, CaptureOptions
from dpr_lab.errors import ConfigError, DprError
from dpr_lab.holding import HangReading
from dpr_lab.rig import Rig, load_rig
from dpr_lab.tui.attempt import Attempt, Phase
from dpr_lab.tui.checklist import kept, next_pose, set_aside
from dpr_lab.tui.countdown import Countdown
from dpr_lab.tui.orders import Asked, Cancel, Capture, Failed, Finished, GoAhead, Idle, Report, Seen
from dpr_lab.tui.stage import Scene, Stage
from dpr_lab.tui.step import Step
from dpr_lab.tui.texts import counted_runs

LENGTHS = (5.0, 10.0, 20.0, 30.0, 60.0)
"""Choices of how long to record, s; after the last comes until rest, and then the first again."""
MOST_REPEATS = 5
PATIENT = CaptureOptions(pose_timeout=1800.0, rest_timeout=120.0)
"""At a screen the operator sees what is missing, so there is time."""


class CaptureStep(Step):
    """The guided release."""

    NAME = "Capture"
    HELP = """
Record one free swing for each pose of the rig.

1. `s` closes the latch and guides you: turn each rod until its mark is between the brackets.
2. Let the rods come to rest in the latch.
3. `r` starts a countdown; **any other key stops it**. At its end the latch opens and the swing is recorded.
4. The recording is judged. `k` keeps it, `a` puts it into `runs/aside` and starts the same pose again.

`x` ends an attempt; the rods stay held, and what was recorded is kept. Nothing but the countdown ever opens the latch.
Up and down choose the pose, `d` how long to record, `e` how often. `c` connects again after the cable was out.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "start", "Start", id="capture.start"),
        Binding("r", "release", "RELEASE", id="capture.release"),
        Binding("k", "keep", "Keep", id="capture.keep"),
        Binding("a", "again", "Again", id="capture.again"),
        Binding("x", "end", "End", id="capture.end"),
        Binding("up", "pose(-1)", "Pose", id="capture.pose_up", show=False),
        Binding("down", "pose(1)", "Pose", id="capture.pose_down", show=False),
        Binding("d", "length", "How long", id="capture.length", show=False),
        Binding("e", "repeats", "How often", id="capture.repeats", show=False),
        Binding("c", "connect", "Connect again", id="capture.connect", show=False),
    ]

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self.options = PATIENT
        self.attempt: Attempt | None = None
        self._rig: Rig | None = None
        self._pose = ""
        self._repeats = 1
        self._idle: Idle | None = None
        self._attempts = 0
        self._countdown: Countdown | None = None

    def compose(self) -> ComposeResult:
        """All of it is drawn by the stage."""
        yield Stage()

    def on_mount(self) -> None:
        """Read the bench's rig; step 2 tells what is wrong with it."""
        with suppress(ConfigError):
            self._rig = load_rig(self.bench.rig)

    def outcome(self) -> str:
        """How many runs there are."""
        count = len(self.bench.runs)
        return counted_runs(count) if count else ""

    def missing(self) -> str:
        """A device, and poses."""
        if self.lab.line.connected is None:
            return "Capture needs a device: press 1 and connect one"
        if self._rig is None:
            return "Capture needs a rig file that can be read: press 2 and choose one"
        if not self._rig.poses:
            return f"The rig {self._rig.name} has no poses: add a table [poses.X1] to its file"
        return ""

    def at_stake(self) -> str:
        """A swing that is being recorded."""
        recording = self.attempt is not None and self.attempt.phase is Phase.RECORDING
        return "the recording under way" if recording else ""

    def enter(self) -> None:
        """Read the rig file again: it may have changed."""
        self._rig = None
        self._rig = load_rig(self.bench.rig)
        if self._pose not in self._rig.poses:
            self._pose = next(iter(self._rig.poses), "")
            self._pose = next_pose(self._done(), self._repeats, self._pose)
        self._draw()

    def hear(self, report: Report) -> None:
        """Follow the attempt under way."""
        match report:
            case Idle():
                self._idle = report
            case Failed():
                self._failed(report)
            case Seen() | Asked() | Finished():
                self._follow(report)
            case _:
                pass
        if self.display and self._rig is not None:
            self._draw()

    def action_start(self) -> None:
        """Begin an attempt at the chosen pose."""
        if self.attempt is not None:
            raise DprError("An attempt is under way: end it with x, or keep (k) or repeat (a) what is recorded")
        if self.missing() or self._rig is None:
            raise DprError(self.missing())
        self._attempts += 1
        self.attempt = Attempt(self._attempts, self._pose, self._rig.poses[self._pose])
        self.lab.line.tell(Capture(self._attempts, self._pose, self.options))
        self._draw()

    def action_release(self) -> None:
        """Count down, then order the release of this attempt; refused unless the rods are in place and still."""
        attempt = self.attempt
        obstacle = attempt.obstacle if attempt is not None else "press s to be guided to the pose first"
        if attempt is None or obstacle:
            self.notify(f"Not released: {obstacle}", severity="warning", markup=False)
            return
        keys = frozenset(
            key for key, active in self.screen.active_bindings.items() if active.binding.id == "capture.release"
        )
        self._countdown = Countdown(attempt.name, keys)
        self.app.push_screen(self._countdown, self._counted_down)

    def action_keep(self) -> None:
        """Take the recording into the bench."""
        captured = self._judged("keep")
        self.bench.runs.append(captured.run_file)
        self.attempt = None
        self._pose = next_pose(self._done(), self._repeats, self._pose)
        self.post_message(self.Done())
        self._draw()

    def action_again(self) -> None:
        """Put the recording aside and try the same pose again."""
        moved = set_aside(self._judged("repeat").run_file)
        self.notify(f"kept aside: {moved}", markup=False)
        self.attempt = None
        self.action_start()

    def action_end(self) -> None:
        """End the attempt under way; the rods stay held."""
        if self.attempt is not None and self.attempt.phase is not Phase.JUDGED:
            self.lab.line.tell(Cancel(self.attempt.number))

    def action_pose(self, by: int) -> None:
        """Choose another pose."""
        if self.attempt is None and self._rig is not None and self._rig.poses:
            names = list(self._rig.poses)
            self._pose = names[(names.index(self._pose) + by) % len(names)]
            self._draw()

    def action_length(self) -> None:
        """Record for longer, or until rest."""
        if self.options.until_rest:
            self.options = replace(self.options, until_rest=False, duration=LENGTHS[0])
        else:
            longer = next((length for length in LENGTHS if length > self.options.duration), None)
            changed = {"until_rest": True} if longer is None else {"duration": longer}
            self.options = replace(self.options, **changed)
        self._draw()

    def action_repeats(self) -> None:
        """Record every pose once more, or only once again."""
        self._repeats = self._repeats % MOST_REPEATS + 1
        self._draw()

    async def action_connect(self) -> None:
        """Connect again, after the cable was out."""
        if self.lab.line.connected is None and not self.lab.line.opening:
            await self.lab.connect()
            self._draw()

    def _counted_down(self, release: bool | None) -> None:
        self._countdown = None
        attempt = self.attempt
        if not release or attempt is None:
            self.notify("Stopped: nothing was released, the rods stay held")
        elif attempt.obstacle:
            self.notify(f"Not released: {attempt.obstacle}", severity="warning", markup=False)
        else:
            self.lab.line.tell(GoAhead(attempt.number, attempt.name, time.monotonic()))

    def _follow(self, report: Seen | Asked | Finished) -> None:
        attempt = self.attempt
        if attempt is None or report.attempt != attempt.number:
            return
        attempt.hear(report)
        if self._countdown is not None and attempt.obstacle:
            self._countdown.stop()
        if isinstance(report, Finished):
            self.post_message(self.Done())
        elif isinstance(report, Seen) and isinstance(report.progress, HangReading) and not report.progress.ok:
            off = ", ".join(f"{math.degrees(error):+.1f}°" for error in report.progress.error)
            warning = f"The rods hang {off} off straight down: counts were lost, or the rig file's zero is wrong"
            self.notify(warning, severity="warning", markup=False)

    def _failed(self, report: Failed) -> None:
        if report.attempt is not None or not report.alive:
            if self._countdown is not None:
                self._countdown.stop()
            if self.attempt is not None and self.attempt.phase is not Phase.JUDGED:
                self.attempt = None
        self.post_message(self.Done())

    def _judged(self, what: str) -> Captured:
        captured = self.attempt.captured if self.attempt is not None else None
        if captured is None:
            raise DprError(f"Nothing to {what} yet: a recording must be finished first")
        return captured

    def _done(self) -> dict[str, int]:
        return kept(self.bench.runs, self._rig.poses if self._rig is not None else ())

    def _draw(self) -> None:
        if self._rig is None or not self.is_mounted:
            return
        scene = Scene(
            rig=self._rig,
            pose=self._pose,
            attempt=self.attempt,
            idle=self._idle,
            options=self.options,
            done=self._done(),
            repeats=self._repeats,
            obstacle=self.missing(),
        )
        self.query_one(Stage).show(scene)
