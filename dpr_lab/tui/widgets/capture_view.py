"""View of a capture: instruction, rods, readouts, remaining poses, and swing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.widgets import Static

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.acquisition.gate import QualityReport
from dpr_lab.acquisition.rest import pose_error
from dpr_lab.report.angles import AngleUnit
from dpr_lab.report.run_names import run_name
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import INPUT_UNITS
from dpr_lab.tui.keys import KeyNames
from dpr_lab.tui.recorder.attempt import Attempt, Phase
from dpr_lab.tui.recorder.sighting import Sighting
from dpr_lab.tui.widgets import readout
from dpr_lab.tui.widgets.chart import Chart, Series, Tone
from dpr_lab.tui.widgets.checklist import checklist_text
from dpr_lab.tui.widgets.pendulum import ArmAbove, Lengths, Pendulum
from dpr_lab.tui.widgets.readout import BAD, GOOD, Placement

BEGIN = "press {capture.start}: the latch closes and you are guided to the pose"
BEGIN_HELD = "the latch is closed; press {capture.start} to be guided to the pose"
ALL_DONE = "all poses are recorded: {app.next} shows the next step. {capture.start} records this pose again"
RELEASING = "RELEASING after the countdown. Any key but {capture.release} stops it"
CODE_FIRST = "RELEASING after you type the displayed code. Any other key stops it"
SENT = "RELEASE sent: the latch opens. Keep clear"
MAY_BE_FREE = "RELEASE was sent, the rods may be free: keep clear until the state of the latch is known again"
CHOICE = "{capture.keep}: keep it  {capture.again}: set it aside and repeat"
TONES = {Phase.READY: "bold $success", Phase.RECORDING: "bold $primary"}


@dataclass(frozen=True, slots=True)
class CaptureState:
    """State of a capture, as displayed."""

    rig: Rig
    pose: str
    """Name of the selected pose; empty if the rig has none."""
    attempt: Attempt | None
    ended: Attempt | None
    """Previous attempt that ended without a verdict, whose recording stays visible; None if there is none."""
    seen: Sighting
    """Last known angles of the rods and state of the latch."""
    now: float
    """Current time, `time.monotonic()`, s."""
    live: bool
    """Whether the last readings are still current."""
    lost: bool
    """Whether a connected device was lost."""
    ordered: float | None
    """Time of a release command whose result is unknown, `time.monotonic()`, s."""
    countdown: bool
    """Whether the countdown to a release runs."""
    code: bool
    """Whether the countdown starts only after the operator typed a code."""
    undecided: str
    """Name of a recorded run that was neither kept nor repeated; empty if there is none."""
    unit: AngleUnit
    keys: KeyNames
    options: CaptureOptions
    done: Mapping[str, int]
    """Number of kept runs by pose."""
    repeats: int
    obstacle: str
    """Reason why no attempt can start; empty if an attempt can start."""

    @property
    def all_done(self) -> bool:
        """Whether every pose has the requested number of recordings and no recording is being repeated."""
        recorded = bool(self.done) and all(number >= self.repeats for number in self.done.values())
        return self.attempt is None and recorded

    @property
    def held(self) -> bool:
        """Whether the latch is currently known to hold the rods."""
        return self.live and self.seen.latched is True


class CaptureView(Vertical):
    """View of the state of a capture."""

    def compose(self) -> ComposeResult:
        """Build the view: instruction at the top, rods and readouts in the middle, swing below."""
        yield Static(id="headline")
        with Horizontal(id="rods"):
            yield Pendulum(id="pendulum")
            yield ArmAbove(id="arm")
            yield Static(id="readout")
            yield Static(id="checklist")
        yield Chart(id="swing")
        yield Chart(id="input")

    def show(self, state: CaptureState) -> None:
        """Draw a state; unchanged parts are not redrawn."""
        swung = state.attempt or state.ended
        self.set_class(swung is not None and swung.phase is Phase.RECORDING and state.live, "-swinging")
        for name, content in (
            ("headline", headline(state)),
            ("readout", Content("\n").join(_readout(state))),
            ("checklist", _plan(state)),
        ):
            shown = self.query_one(f"#{name}", Static)
            if shown.content != content:
                shown.update(content, layout=name == "headline")
        self._show_rods(state)
        self._show_swing(swung, state.unit, state.rig, ended_early=state.attempt is None)
        self._show_input(swung, state.rig)

    def _show_rods(self, state: CaptureState) -> None:
        rig, attempt = state.rig, state.attempt
        swinging = attempt is not None and attempt.phase in (Phase.RECORDING, Phase.JUDGED)
        wanted = rig.poses.get(state.pose) if not swinging and state.live and not state.all_done else None
        lengths = _lengths(rig)
        pose = None if wanted is None else wanted.theta.tolist()
        self.query_one(Pendulum).show(state.seen.theta, pose, lengths, old=not state.live)
        self.set_class(rig.arm.mode != "clamped", "-arm-moves")
        if rig.arm.mode != "clamped":
            theta0 = None if state.seen.theta is None else state.seen.theta[0]
            self.query_one(ArmAbove).show(theta0, rig.arm.limits, old=not state.live)

    def _show_input(self, attempt: Attempt | None, rig: Rig) -> None:
        """Plot the input of the arm's drive below the angles, if the device reports it."""
        inputs = attempt.inputs if attempt is not None else np.empty(0)
        driven = attempt is not None and rig.motor is not None and len(inputs) > 0
        self.set_class(driven, "-driven")
        if driven and attempt is not None and rig.motor is not None:
            quantity = f"{rig.motor.input} ({INPUT_UNITS[rig.motor.input]})"
            line = Series(rig.motor.input, attempt.trace[0], inputs, tone="accent")
            self.query_one("#input", Chart).show([line], x_label="time (s)", y_label=quantity)

    def _show_swing(self, attempt: Attempt | None, unit: AngleUnit, rig: Rig, *, ended_early: bool) -> None:
        t, theta = attempt.trace if attempt is not None else (np.empty(0), np.empty((0, 3)))
        symbol = unit.symbol.strip()
        turns = np.round((theta[0] - attempt.pose.theta) / (2 * np.pi)) if attempt is not None and len(t) else 0
        shown = (theta - 2 * np.pi * turns) * unit.per_rad
        names = ("θ1 inner", "θ2 outer") if rig.rods.number == 2 else ("θ1 rod",)
        tones: tuple[Tone, Tone] = ("primary", "secondary")
        rods = zip(names, shown[:, 1:].T, tones, strict=False)
        lines = [Series(name, t, angle, tone=tone) for name, angle, tone in rods]
        if rig.arm.mode != "clamped":
            lines.append(Series("θ0 arm", t, shown[:, 0], tone="accent"))
        self.query_one("#swing", Chart).show(
            lines,
            x_label="time (s)",
            y_label=f"ended early: angle ({symbol})" if ended_early and len(t) else f"angle ({symbol}, 0 = upright)",
        )


def _lengths(rig: Rig) -> Lengths:
    """Return the lengths of the drawn rods.

    A single rod is drawn as the inner one.
    """
    outer = rig.L2 or rig.L1
    if rig.rods.number == 2:
        return Lengths(rig.L0, rig.L1, outer)
    return Lengths(rig.L0, outer if rig.rods.mounted == "outer" else rig.L1, 0.0)


def headline(state: CaptureState) -> Content:
    """Return one line with the next action of the operator."""
    attempt = state.attempt
    if state.countdown and state.live:
        releasing = CODE_FIRST if state.code else RELEASING
        return Content.styled(f"{state.pose}: {state.keys.fill(releasing)}", "bold $background on $warning")
    if state.lost:
        return Content.styled(_after_loss(state), "bold $background on $error")
    if attempt is not None and attempt.captured is not None:
        ok = attempt.captured.quality.ok
        text = f"{attempt.name}: {GOOD + ' good' if ok else BAD + ' degraded'}. {state.keys.fill(CHOICE)}"
        return Content.styled(text, "bold $success" if ok else "bold $warning")
    if state.ordered is not None and (attempt is None or attempt.phase is not Phase.RECORDING):
        return Content.styled(SENT if state.live and attempt else MAY_BE_FREE, "bold $background on $warning")
    if attempt is None and state.undecided:
        return Content.styled(f"{state.undecided}: not decided yet. {state.keys.fill(CHOICE)}", "bold $warning")
    if attempt is None:
        begin = ALL_DONE if state.all_done else BEGIN_HELD if state.held else BEGIN
        text = state.obstacle or state.keys.fill(begin)
        return Content.styled(
            f"{state.pose}: {text}" if state.pose else text, "bold $warning" if state.obstacle else ""
        )
    if not state.live:
        return Content.styled(f"NO MESSAGE from the device, {state.seen.ago(state.now)}: keep clear", "bold $error")
    return Content.styled(f"{attempt.name}: {_now(attempt, state)}", TONES.get(attempt.phase, "bold"))


def _after_loss(state: CaptureState) -> str:
    swung = state.ended is not None and state.ended.phase is Phase.RECORDING
    danger = "the rods may swing" if swung else "the latch may open"
    if state.ordered is not None and not swung:
        danger = "RELEASE was sent, the rods may be free"
    return state.keys.fill(f"DEVICE LOST: {danger}, keep clear; check the cable, {{capture.connect}}: connect again")


def _now(attempt: Attempt, state: CaptureState) -> str:
    if attempt.phase is Phase.READY:
        return state.keys.fill("at the pose and at rest. Press {capture.release} to RELEASE")
    if attempt.recorded is None:
        return attempt.phase.value
    until = "until rest" if state.options.until_rest else f"of {state.options.duration:g} s"
    return f"{attempt.phase.value}, {attempt.recorded.t:.1f} s {until}"


def _readout(state: CaptureState) -> Iterator[Content]:
    attempt = state.attempt
    if attempt is not None and attempt.captured is not None:
        yield from _judgement(attempt.captured.quality)
        yield readout.lost_text(attempt.captured.lost, None)
        yield Content(f"run    {run_name(attempt.captured.run_file)}")
        return
    if not state.live:
        yield readout.old_text(state.seen, state.ordered, state.now, state.unit, state.rig.rods.number)
    else:
        yield from _live(state)
    if attempt is not None:
        yield readout.lost_text(attempt.lost, attempt.recorded.samples if attempt.recorded is not None else None)


def _live(state: CaptureState) -> Iterator[Content]:
    attempt, placement = state.attempt, _placement(state)
    if placement is not None:
        yield readout.placement_text(placement, state.unit)
    elif state.seen.theta is not None:
        yield Content.styled(readout.angles_text(state.seen.theta, state.unit, state.rig.rods.number), "bold")
    if attempt is not None and attempt.phase is Phase.RECORDING and attempt.recorded is not None:
        yield Content(state.unit.speeds(attempt.recorded.omega[: state.rig.rods.number]))
    if attempt is not None and attempt.phase is not Phase.RECORDING:
        yield readout.rest_text(attempt.rest, state.rig, state.unit)
        if state.rig.arm.mode != "clamped":
            yield readout.arm_text(attempt.rest, state.rig, state.unit)
    if state.ordered is not None:
        yield readout.ordered_text(state.ordered, state.now)
    else:
        yield readout.latch_text(state.seen.latched)


def _judgement(verdict: QualityReport) -> Iterator[Content]:
    passed = sum(check.ok for check in verdict.checks)
    yield Content.styled(f"{passed} of {len(verdict.checks)} checks passed", "bold")
    for reason in verdict.reasons:
        yield Content.styled(f"{BAD} {reason}", "$warning")
    for note in verdict.notes:
        yield Content(note)


def _placement(state: CaptureState) -> Placement | None:
    """Return the target angles of the rods and their errors; None if there is no target or no reading."""
    if state.all_done:
        return None
    if state.attempt is not None:
        pose, error = state.attempt.pose, state.attempt.error
    else:
        pose, theta = state.rig.poses.get(state.pose), state.seen.theta
        error = pose_error(np.array(theta), pose).tolist() if pose is not None and theta is not None else None
    if pose is None or error is None:
        return None
    placed = state.rig.rods.placed
    return Placement((pose.theta1, pose.theta2)[:placed], tuple(error[:placed]), pose.tolerance)


def _plan(state: CaptureState) -> Content:
    options = state.options
    length = f"until rest, at most {options.max_duration:g} s" if options.until_rest else f"for {options.duration:g} s"
    return Content("\n").join(
        [
            checklist_text(state.done, state.repeats, state.pose),
            Content.styled(
                f"\n{state.keys.key_for('capture.length')}: record {length}"
                f"\n{state.keys.key_for('capture.repeats')}: {state.repeats} of each pose",
                "dim",
            ),
        ]
    )
