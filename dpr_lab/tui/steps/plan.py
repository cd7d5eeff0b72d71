"""Step Plan: the next recordings, and when to stop.

A proposed release can become the next pose of the step Capture.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import DataTable, Input, Label, Static

from dpr_lab.errors import DprError
from dpr_lab.progress import StageBegan
from dpr_lab.report.angles import AngleUnit
from dpr_lab.rig import load_rig
from dpr_lab.shown import percent
from dpr_lab.tui.jobs import jobs
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.path_suggester import PathSuggester
from dpr_lab.tui.steps.result_step import ResultStep
from dpr_lab.tui.texts import report_table, sentences, table
from dpr_lab.workflows.plan import PlanRequest, PlanResult, plan

if TYPE_CHECKING:
    from dpr_lab.planning.result import Plan, PlannedRelease

COLUMNS = ("release", "start pose", "duration", "minutes", "distinguished")
FORECAST = "P(decided)"
PLANNING = "planning the next releases"
ONE = "select a release in the list first; {plan.start} creates the list"
OTHER_SETUP = (
    "{text}: the rig file describes other rods or masses. Change [rods] or [added_mass] in the rig file"
    " ({rig.write} in step {rig}), then plan again"
)
DRIVEN = "{text}: the device must replay {file}; record it with dpr-lab capture"


class PlanStep(ResultStep[PlanResult]):
    """Step that plans the next releases, and writes plan.json and a rig file with the planned poses."""

    NAME = "Plan"
    PURPOSE = "recommends the next recordings, with reason and duration, and reports when no more recordings are needed"
    RESULT = "plan"
    RESTS_ON = ("the rig", "the runs", "the held-out runs", "the torques")
    HELP = """
Recommends the next releases as a ranked list: start pose, duration, reason, and minutes at the rig. The first plan is
based only on the rig file, later plans also on the runs and their diagnosis. Runs that are not diagnosed yet are
diagnosed first.

- **limits file**: the poses that can be reached, the parts that can be mounted, and the duration of each step.
- **budget**: time at the rig, such as `10min`; if it is empty, up to three releases are planned.
- **distinguished**: mean expected information about a pair of effects of the library, from all releases up to this one.
  0 %: no pair is distinguished; 100 %: all pairs are.
- **P(decided)**: probability that the causes are decided after this release. Causes that no release separates count as
  one cause.
- `{plan.take}` makes the selected release the next release of Capture: its pose, its duration, and the rig file that
  describes its rods, mass and arm. The rods are not released by this: Capture guides you to the pose as usual.

`plan.json` and rig files with the planned poses are written to `plan/` in the folder of the workspace, as
`dpr-lab plan --out` writes them.
"""
    BINDINGS = bindings("plan")
    DEFAULT_CSS = """
    PlanStep #form { height: 1; }
    PlanStep #form Label { padding: 0 1 0 0; }
    PlanStep #limits { width: 1fr; max-width: 44; margin-right: 2; }
    PlanStep #budget { width: 9; }
    PlanStep #state { height: auto; max-height: 4; text-style: bold; }
    PlanStep DataTable { height: auto; max-height: 9; }
    PlanStep VerticalScroll { height: 1fr; }
    """

    def compose(self) -> ComposeResult:
        """Build the form, the recommendation, the releases, and the details of the selected release."""
        with Horizontal(id="form"):
            yield Label("limits file")
            yield Input(placeholder="none", id="limits", suggester=PathSuggester(".toml"), compact=True)
            yield Label("budget")
            yield Input(placeholder="none", id="budget", compact=True)
        yield Static(id="state", markup=False)
        yield DataTable[Text](cursor_type="row", zebra_stripes=True)
        with VerticalScroll():
            yield Static(id="details")

    def missing(self) -> str:
        """Return an empty text, because a first plan needs only a rig file."""
        return ""

    def outcome(self) -> str:
        """Return the state of the plan in a few words; empty without a plan."""
        if self.result is None:
            return ""
        planned, count = self.result.plan, len(self.result.plan.releases)
        if planned.state in ("enough", "bench check"):
            return f"{planned.state}, {count} optional" if count else planned.state
        return f"{count} to record"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether an action is available; choosing a release needs a plan with releases."""
        if action == "take":
            return self.result is not None and bool(self.result.plan.releases) and self.job is None
        return super().check_action(action, parameters)

    def start_work(self) -> None:
        """Plan with the current runs and their diagnosis."""
        limits, budget = (self.query_one(f"#{name}", Input).value.strip() for name in ("limits", "budget"))
        runs = tuple(run for run in self.workspace.runs if run not in self.workspace.held_out)
        request = PlanRequest(
            rig=self.workspace.rig,
            runs=runs,
            diagnosis=self._diagnosis() if runs else None,
            limits=Path(limits).expanduser() if limits else None,
            budget=budget or None,
            out=self.workspace.out / "plan",
            torque=self.workspace.driven_by,
        )
        self.say(PLANNING)
        self.begin(jobs.workflow, job=plan, request=request)

    def progressed(self, value: Any) -> None:
        """Show the stages of the diagnosis that precedes a plan."""
        if isinstance(value, StageBegan):
            self.say(f"diagnosing first, step {value.number} of {value.of}: {value.name}")

    def finished(self, result: Any) -> None:
        """Show the plan, which is already saved."""
        self.show(result)
        if self.display and result.plan.releases:
            self.query_one(DataTable).focus()

    async def action_take(self) -> None:
        """Make the selected release the next pose of Capture; the rods are not released."""
        release = self._marked
        if release is None or self.result is None or release.pose is None or release.rig is None:
            raise DprError(self.worded(ONE))
        if release.input is not None:
            raise DprError(DRIVEN.format(text=release.text, file=release.input))
        mounted = "" if release.rig == self.result.files["rig"] else f" ({release.text})"
        if not mounted:
            self._refuse_changed_setup(release)
        self.services.require_free()
        self.workspace.rig = str(Path(release.rig).resolve())
        self.workspace.used(self.workspace.rig)
        self.workspace.next_pose, self.workspace.next_duration_s = release.pose, release.duration_s
        if self.device.connected is not None:
            await self.services.connect()  # the recorder reads the rig file with the new pose
        capture = self.services.key_of("Capture")
        self.say(
            f"{release.pose} for {release.duration_s:g} s{mounted} is the next release of Capture: press {capture}"
        )
        self.changed()

    def _refuse_changed_setup(self, release: "PlannedRelease") -> None:
        """Refuse a release that was planned for other rods or masses.

        The rods and masses of the rig file are compared with those of the plan.
        """
        rig = load_rig(self.workspace.rig)
        mounting = "clamped" if release.elbow == "clamped" else release.mounted
        if (mounting, release.added_mass) != (rig.rods.mounting, rig.added_mass):
            text = OTHER_SETUP.replace("{text}", release.text).replace("{rig}", self.services.key_of("Rig"))
            raise DprError(self.worded(text))

    @property
    def _marked(self) -> "PlannedRelease | None":
        releases = self.result.plan.releases if self.result is not None else []
        row = self.query_one(DataTable).cursor_row
        return releases[row] if 0 <= row < len(releases) else None

    def _diagnosis(self) -> Path | None:
        """Return the diagnosis of the selected runs in the workspace, or None."""
        used, now = self.workspace.made_from.get("Diagnose", {}), self.workspace.basis()
        unchanged = all(used.get(kind) == now[kind] for kind in self.RESTS_ON)
        return self.workspace.diagnosis if unchanged else None

    def draw(self, result: PlanResult) -> str:
        """Draw the releases and the details of the selected one; return the recommendation."""
        from dpr_lab.report.words import in_words

        planned, releases = result.plan, self.query_one(DataTable)
        row = releases.cursor_row
        releases.display = bool(planned.releases)
        releases.clear(columns=True)
        releases.add_columns(*COLUMNS, *[FORECAST] * bool(planned.forecast))
        for release in planned.releases:
            releases.add_row(*(Text(cell) for cell in _row(release, self.workspace.unit)))
        releases.move_cursor(row=row)
        self._show_details()
        return in_words(planned.sentence)

    @on(DataTable.RowHighlighted)
    def _show_details(self) -> None:
        if self.result is not None:
            self.put("details", _details(self.result.plan, self._marked))


def _row(release: "PlannedRelease", unit: AngleUnit) -> tuple[str, ...]:
    angles = [release.theta1_rad, release.theta2_rad][: 2 if release.mounted == "both" else 1]
    pose = "  ".join(map(unit.text, angles))
    decided = [] if release.decided is None else [f"{release.decided:.2f}"]
    name = release.pose or str(release.number)
    return (name, pose, f"{release.duration_s:g} s", f"{release.minutes:.1f}", percent(release.library_bits), *decided)


def _details(planned: "Plan", release: "PlannedRelease | None") -> RenderableType:
    """Draw the selected release, the causes that no release separates, and the assumptions."""
    from dpr_lab.report.tables import limit_forecast_table, ratio_std_table
    from dpr_lab.report.words import in_words, named

    shown: list[RenderableType] = []
    if release is not None:
        lines = [
            release.text,
            f"reason: {in_words(release.reason)}",
            f"horizon: {release.horizon_s:.1f} s; later, small errors of the start pose change the swing",
        ]
        shown.append(sentences(f"Release {release.number}", lines))
        if pairs := planned.separable(release):
            rows = [(*map(named, pair.causes), f"{pair.bits:.2f}") for pair in pairs]
            shown += [table("Undecided causes", ("cause", "or", "expected bits"), rows), ""]
        columns = ("ratio", "now", "after this release", "unit")
        shown += [table("Standard deviation of each ratio", columns, ratio_std_table(planned, release).rows), ""]
    if planned.limits:
        shown += [report_table("Limits of the rig", limit_forecast_table(planned)), ""]
    checks = [
        in_words(f"{' or '.join(inseparable.causes)}: {inseparable.check}") for inseparable in planned.inseparable
    ]
    shown.append(sentences("No release separates these causes", checks))
    shown.append(sentences("Assumptions", planned.assumptions))
    return Group(*shown)
