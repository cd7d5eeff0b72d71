"""Step Compare: compare model and measurement, with a free run of each run."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.content import Content
from textual.events import Resize
from textual.widgets import Select, Static

from dpr_lab.errors import RunError
from dpr_lab.report.run_names import compared_name, run_name
from dpr_lab.shown import counted
from dpr_lab.tui.jobs import jobs
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps import arm_results
from dpr_lab.tui.steps.compare_charts import AXES, SETTINGS, VIEWS, ComparedRun
from dpr_lab.tui.steps.job_step import JobStep
from dpr_lab.tui.steps.second_curve import SecondCurve
from dpr_lab.tui.texts import following
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.workflows.compare import CompareRequest
from dpr_lab.workflows.events import RunCompared, RunLeftOut

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.identify import AnyComparison


class CompareStep(JobStep):
    """Step that shows measured and simulated angles and their difference."""

    NAME = "Compare"
    PURPOSE = "simulates the runs with the model"
    RESTS_ON = ("the runs", "the model", "the torques")
    HELP = f"""
Simulates every selected run with the model. A **free run** starts from the state fitted at the release and is not
corrected afterwards. It is predictable up to the horizon (line in the chart). Beyond the horizon, the uncertainty of
the initial state alone changes the simulation visibly, so the difference does not test the model. A rig whose arm
moves is compared by segment only.

The **segment residual** is the residual of half-second segments with fitted initial states. A residual inside the band
(±{SETTINGS.noise_sigmas}σ of the noise floor) and without a pattern is noise.

`{{compare.second}}` draws a second curve in the same chart: another run, or the same run simulated with another model.
Enter the file of that model in the field (`{{compare.edit}}`), for example the corrected `diagnosis/model.json`.

Keys in the chart: + and - zoom, the arrows pan, shift with up or down scales the vertical axis, 0 resets the view.
`{{chart.cursors}}` sets two cursors that show values and differences. Pressing it again selects the other cursor;
pressing it a third time removes both. `{{chart.cursor_back}}` and `{{chart.cursor_on}}` move the selected cursor,
`{{chart.cursor_far_back}}` and `{{chart.cursor_far_on}}` move it by larger steps.

Figures, report and numbers are written to `report/` in the folder of the workspace, as by `dpr-lab compare`.
"""
    BINDINGS = bindings("compare")
    DEFAULT_CSS = """
    CompareStep #pickers { height: 1; }
    CompareStep #pickers Select { width: 1fr; margin-right: 1; }
    CompareStep #pickers #run { width: 2fr; }
    CompareStep #figures { height: auto; max-height: 4; }
    """

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self._compared_subject: tuple[Path, float, tuple[Path, ...], str | None] | None = None
        self._compared: Sequence[AnyComparison] = ()
        self._arm_moves = False
        self._joints, self._views = [0, 1], VIEWS
        self._left_out = 0

    def compose(self) -> ComposeResult:
        """Build selectors, charts and text."""
        with Horizontal(id="pickers"):
            yield Select[int]([], prompt="no run yet", id="run", compact=True)
            yield Select(list(zip(AXES, (0, 1), strict=True)), value=1, allow_blank=False, id="axis", compact=True)
            yield Select([(view, view) for view in VIEWS], value=VIEWS[0], allow_blank=False, id="view", compact=True)
        yield SecondCurve(self.services)
        yield Chart(id="angle")
        yield Chart(id="error")
        yield Static(id="figures", markup=False)

    def missing(self) -> str:
        """Name the missing model or runs; return an empty text if both exist."""
        known = self.workspace.model is not None and self.workspace.model.is_file()
        no_model = f"No model yet: identify one in step {self.services.key_of('Identify')}"
        return super().missing() or ("" if known else no_model)

    def outcome(self) -> str:
        """Return the number of compared runs as text."""
        return counted(len(self._compared), "run") if self._compared and self._compared_subject is not None else ""

    def enter(self) -> None:
        """Show the last comparison, or start one if there is none.

        An outdated comparison is shown and marked as such.
        """
        self._draw()
        if self.missing():
            self.say(self.missing())
        elif not self._compared and self._compared_subject != self._subject():
            self.start_work()

    def report(self) -> Path | None:
        """Return the path of the report, which is the same as that of `dpr-lab compare`."""
        return self.workspace.out / "report" / "report.html"

    def stale(self) -> str:
        """Return a message if the model, runs or torques changed since the last comparison.

        Otherwise return an empty text.
        """
        if not self._compared or self.job is not None or self.missing() or self._compared_subject == self._subject():
            return ""
        return self.worded("STALE, model, runs or torques changed; {compare.start}: run again")

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether an action is available.

        If the arm moves, there is no second curve.
        """
        return not (action == "second_curve" and self._arm_moves) and super().check_action(action, parameters)

    def start_work(self) -> None:
        """Compare the selected runs with the model."""
        model = self.workspace.model
        if model is None:
            return
        self._compared_subject = self._subject()
        self._compared, self._left_out = (), 0
        self.say("simulating")
        out = self.workspace.out / "report"
        runs, record = tuple(self.workspace.runs), out / "comparison.json"
        request = CompareRequest(runs, model, out, leave_out=True, record=record, torque=self.workspace.driven_by)
        self.begin(jobs.compare, request=request)

    def progressed(self, value: Any) -> None:
        """Show a compared or skipped run."""
        match value:
            case RunCompared(comparison):
                self.show([*self._compared, comparison])
            case RunLeftOut(why=why):
                self._left_out += 1
                raise RunError(why)

    def finished(self, result: tuple[Path, ...]) -> None:
        """Name the folder of the report, and the runs `result` that were skipped."""
        without = f"; skipped: {', '.join(map(run_name, result))}" if result else ""
        self._draw(self.worded(f"saved in {self.workspace.out / 'report'}, {{app.report}} opens it{without}"))

    def ended(self, why: str) -> None:
        """Show why the job ended."""
        self._compared_subject = None
        self.say(self.worded(f"{why} ({{app.browse}})") if self._left_out and not self._compared else why)

    def action_cycle(self, what: str) -> None:
        """Show the next run, axis or view."""
        picker = self.query_one(f"#{what}", Select)
        options = {"run": range(len(self._compared)), "axis": self._joints, "view": self._views}[what]
        if len(options):
            picker.value = following(options, picker.value)
        next(chart for chart in self.query(Chart) if chart.display).focus()

    def action_edit(self) -> None:
        """Focus the field for the file of the second model."""
        self.query_one(SecondCurve).edit()

    def action_second_curve(self) -> None:
        """Show the next run or model as second curve."""
        self.query_one(SecondCurve).cycle()

    @on(SecondCurve.Offered)
    def _draw_second(self, event: SecondCurve.Offered) -> None:
        self._draw(event.news)

    def show(self, comparisons: "Sequence[AnyComparison]") -> None:
        """Offer compared runs; draw the selected one."""
        from dpr_lab.identification.compare import Comparison

        self._compared, self._arm_moves = comparisons, not isinstance(comparisons[0], Comparison)
        self._offer_runs()

    @on(Select.Changed)
    def _picked(self, event: Select.Changed) -> None:
        event.stop()
        if event.select.id == "run" and not self._arm_moves:
            self._offer_second()
        self._draw()

    def on_resize(self, event: Resize) -> None:
        """Show angle and error together if the screen is tall enough."""
        self._arrange()

    @property
    def _shown(self) -> "AnyComparison | None":
        run = self.query_one("#run", Select).value
        return self._compared[run] if isinstance(run, int) and run < len(self._compared) else None

    def _subject(self) -> tuple[Path, float, tuple[Path, ...], str | None]:
        model = self.workspace.model or Path()
        return model, model.stat().st_mtime, tuple(self.workspace.runs), self.workspace.driven_by

    @property
    def _names(self) -> list[str]:
        """Names of the compared runs."""
        return [f"{compared_name(run)} ({'held out' if run.held_out else 'used'})" for run in self._compared]

    def _offer_runs(self) -> None:
        picker = self.query_one("#run", Select)
        current = picker.value if isinstance(picker.value, int) else 0
        picker.prompt = "choose a run"
        names = self._names
        picker.set_options([(Content(name), i) for i, name in enumerate(names)])
        picker.value = min(current, len(names) - 1)
        self._offer_joints()
        self._offer_second()

    def _offer_joints(self) -> None:
        """Offer the joints and views of the compared model.

        A model with a moving arm has its own joints and no free runs.
        """
        from dpr_lab.identification.moving_arm.identify import ArmComparison

        self.query_one(SecondCurve).display = not self._arm_moves
        names, joints, views = AXES, [0, 1], VIEWS
        if isinstance(first := self._compared[0], ArmComparison):
            names, joints, views = arm_results.JOINT_NAMES, arm_results.joints_of(first), arm_results.VIEWS
        if (joints, views) == (self._joints, self._views):
            return
        self._joints, self._views = joints, views
        axis, view = self.query_one("#axis", Select), self.query_one("#view", Select)
        axis.set_options([(names[joint], joint) for joint in joints])
        view.set_options([(name, name) for name in views])
        axis.value, view.value = joints[-1], views[0]

    def _offer_second(self) -> None:
        from dpr_lab.identification.compare import Comparison

        number = self.query_one("#run", Select).value
        runs = [run for run in self._compared if isinstance(run, Comparison)]
        self.query_one(SecondCurve).offer(runs, self._names[: len(runs)], number if isinstance(number, int) else 0)

    def _arrange(self) -> None:
        view = self.query_one("#view", Select).value
        tall = self.size.height >= SETTINGS.tall
        self.query_one("#angle", Chart).display = tall or view == VIEWS[0]
        self.query_one("#error", Chart).display = tall or view != VIEWS[0]

    def _draw(self, news: str = "") -> None:
        self._arrange()
        shown, joint, unit = self._shown, self.query_one("#axis", Select).value, self.workspace.unit
        if shown is None or not isinstance(joint, int):
            return
        from dpr_lab.identification.compare import Comparison

        if isinstance(shown, Comparison):
            second = self.query_one(SecondCurve).chosen
            freely = self.query_one("#view", Select).value == VIEWS[1]
            compared = ComparedRun(shown, second, joint, unit, freely)
        else:
            compared = arm_results.ComparedArmRun(shown, joint, unit)
        compared.draw_angle(self.query_one("#angle", Chart))
        compared.draw_error(self.query_one("#error", Chart))
        self.say(compared.figures(news))

    def say(self, text: str) -> None:
        """Show a sentence in place of the figures."""
        self.put("figures", text)
