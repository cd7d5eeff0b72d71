"""The picture of a capture: what to do, the rods, the read-outs, the poses to go, and the swing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.widgets import Static

from dpr_lab.capture import CaptureOptions
from dpr_lab.gate import Verdict, pose_error
from dpr_lab.rig import Pose, Rig
from dpr_lab.tui import readout
from dpr_lab.tui.attempt import Attempt, Phase
from dpr_lab.tui.chart import Chart, Series
from dpr_lab.tui.checklist import checklist_text
from dpr_lab.tui.orders import Idle
from dpr_lab.tui.pendulum import Lengths, Pendulum
from dpr_lab.tui.readout import BAD, GOOD, Placement

TONES = {Phase.READY: "bold $success", Phase.RECORDING: "bold $primary"}


@dataclass(frozen=True, slots=True)
class Scene:
    """What is to be seen."""

    rig: Rig
    pose: str
    """Name of the chosen pose; empty where the rig has none."""
    attempt: Attempt | None
    idle: Idle | None
    options: CaptureOptions
    done: Mapping[str, int]
    """Runs kept, by pose."""
    repeats: int
    obstacle: str
    """Why no attempt can begin; empty when one can."""


class Stage(Vertical):
    """Shows a scene."""

    def compose(self) -> ComposeResult:
        """What to do on top, rods and read-outs below, the swing at the foot."""
        yield Static(id="headline")
        with Horizontal(id="rods"):
            yield Pendulum(id="pendulum")
            yield Static(id="readout")
            yield Static(id="checklist")
        yield Chart(id="swing")

    def show(self, scene: Scene) -> None:
        """Draw a scene."""
        self.query_one("#headline", Static).update(headline(scene))
        self.query_one("#readout", Static).update(Content("\n").join(_readout(scene)))
        self.query_one("#checklist", Static).update(_plan(scene))
        self._show_rods(scene)
        self._show_swing(scene.attempt)

    def _show_rods(self, scene: Scene) -> None:
        rig, attempt = scene.rig, scene.attempt
        swinging = attempt is not None and attempt.phase in (Phase.RECORDING, Phase.JUDGED)
        wanted = rig.poses.get(scene.pose) if not swinging else None
        lengths = Lengths(rig.rig.L0, rig.rig.L1, rig.rig.L2 or rig.rig.L1)
        self.query_one(Pendulum).show(_theta(scene), None if wanted is None else wanted.theta.tolist(), lengths)

    def _show_swing(self, attempt: Attempt | None) -> None:
        t, theta = attempt.trace if attempt is not None else (np.empty(0), np.empty((0, 3)))
        shown = np.degrees(theta)
        lines = [Series("θ1 inner", t, shown[:, 1]), Series("θ2 outer", t, shown[:, 2], tone="secondary", dashed=True)]
        self.query_one(Chart).show(lines, x_label="time since the release (s)", y_label="angle (°, 0 = upright)")


def headline(scene: Scene) -> Content:
    """What to do now, in one line."""
    attempt = scene.attempt
    if attempt is None:
        said = scene.obstacle or "press s: the latch closes and you are guided to the pose"
        return Content.styled(
            f"{scene.pose}: {said}" if scene.pose else said, "bold $warning" if scene.obstacle else ""
        )
    if attempt.captured is not None:
        ok = attempt.captured.verdict.ok
        word = f"{GOOD} good" if ok else f"{BAD} degraded"
        said = f"{attempt.name}: {word}. k: keep it  a: put it aside and repeat"
        return Content.styled(said, "bold $success" if ok else "bold $warning")
    return Content.styled(f"{attempt.name}: {_now(attempt, scene.options)}", TONES.get(attempt.phase, "bold"))


def _now(attempt: Attempt, options: CaptureOptions) -> str:
    if attempt.phase is Phase.READY:
        return "at the pose and at rest. Press r to RELEASE"
    if attempt.recorded is None:
        return attempt.phase.value
    until = "until rest" if options.until_rest else f"of {options.duration:g} s"
    return f"{attempt.phase.value}, {attempt.recorded.t:.1f} s {until}"


def _readout(scene: Scene) -> Iterator[Content]:
    attempt = scene.attempt
    if attempt is not None and attempt.captured is not None:
        yield from _judgement(attempt.captured.verdict)
        yield readout.lost_text(attempt.captured.lost, None)
        yield Content(attempt.captured.run_file.name)
        return
    placement = _placement(scene)
    if placement is not None:
        yield readout.placement_text(placement)
    elif (theta := _theta(scene)) is not None:
        yield Content.styled(readout.degrees(theta), "bold")
    if attempt is None:
        yield readout.latch_text(scene.idle.latched if scene.idle is not None else None)
        return
    if attempt.phase is not Phase.RECORDING:
        yield readout.rest_text(attempt.rest)
    yield readout.latch_text(attempt.latched)
    yield readout.lost_text(attempt.lost, attempt.recorded.samples if attempt.recorded is not None else None)


def _judgement(verdict: Verdict) -> Iterator[Content]:
    passed = sum(check.ok for check in verdict.checks)
    yield Content.styled(f"{passed} of {len(verdict.checks)} checks passed", "bold")
    for reason in verdict.reasons:
        yield Content.styled(f"{BAD} {reason}", "$warning")
    for note in verdict.notes:
        yield Content(note)


def _placement(scene: Scene) -> Placement | None:
    if scene.attempt is not None:
        return scene.attempt.placement
    pose, theta = scene.rig.poses.get(scene.pose), _theta(scene)
    if pose is None or theta is None:
        return None
    return Placement((pose.theta1, pose.theta2), _error(theta, pose), pose.tolerance)


def _error(theta: tuple[float, float, float], pose: Pose) -> tuple[float, float]:
    inner, outer = pose_error(np.array(theta), pose).tolist()
    return inner, outer


def _theta(scene: Scene) -> tuple[float, float, float] | None:
    if scene.attempt is not None and scene.attempt.theta is not None:
        return scene.attempt.theta
    return scene.idle.theta if scene.idle is not None else None


def _plan(scene: Scene) -> Content:
    options = scene.options
    length = f"until rest, at most {options.max_duration:g} s" if options.until_rest else f"for {options.duration:g} s"
    return Content("\n").join(
        [
            checklist_text(scene.done, scene.repeats, scene.pose),
            Content.styled(f"\nd: record {length}\ne: {scene.repeats} of each pose", "dim"),
        ]
    )
