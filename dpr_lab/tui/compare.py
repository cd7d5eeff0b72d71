"""Step 5: the model beside the measurement, from any release and from any instant of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.events import Resize
from textual.widgets import Select, Static

from dpr_lab.errors import RunError
from dpr_lab.tui import tasks
from dpr_lab.tui.chart import Band, Chart, Mark, Series
from dpr_lab.tui.slider import Slider
from dpr_lab.tui.tasks import Answer, LeftOut, Note, Start
from dpr_lab.tui.texts import counted_runs
from dpr_lab.tui.working import NO_RUNS, WorkingStep

if TYPE_CHECKING:
    from dpr_lab.compare import Comparison, FreeRun

AXES = ("inner rod θ1", "outer rod θ2")
VIEWS = ("angle", "free-run error", "segment residual")
NOISE_SIGMAS = 2
TALL = 36
"""Rows of the step from which on angle and error are shown one above the other."""

STEP_S = 0.5
"""Spacing of the instants a free run can start from: the segments' length."""

_MRAD = 1e3


class CompareStep(WorkingStep):
    """Measured and simulated angles, and what is left between them."""

    NAME = "Compare"
    WORK = ""
    HELP = f"""
Simulates every selected run with the model. A **free run** starts from the state fitted at one instant and goes on by
itself; the slider moves that instant. It can be predicted up to the horizon (bar on the slider, line in the chart):
beyond it the start state's uncertainty alone moves the simulation visibly, which says nothing about the model.

The **segment residual** is what half-second segments with free start states leave; inside the band (±{NOISE_SIGMAS}σ of
the noise floor) and without a pattern it is noise.

In the chart: + and - zoom, arrows move, shift with up and down stretches, 0 shows everything again. Figures, report and
numbers are written to `report/` in the bench's folder, as `dpr-lab compare` writes them.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("s", "start", "Again", id="compare.start"),
        Binding("v", "cycle('view')", "View", id="compare.view"),
        Binding("o", "cycle('run')", "Run", id="compare.run"),
        Binding("a", "cycle('axis')", "Axis", id="compare.axis"),
        Binding("left_square_bracket", "start_at(-1)", "Start earlier", id="compare.earlier", show=False),
        Binding("right_square_bracket", "start_at(1)", "Start later", id="compare.later", show=False),
    ]
    DEFAULT_CSS = """
    CompareStep #pickers { height: 1; }
    CompareStep #pickers Select { width: 1fr; margin-right: 1; }
    CompareStep #pickers #run { width: 2fr; }
    CompareStep #figures { height: auto; max-height: 2; }
    """

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._of: tuple[Path, float, tuple[Path, ...]] | None = None
        self._comparisons: list[Comparison] = []
        self._free_runs: dict[Start, FreeRun] = {}
        self._wanted: Start | None = None

    def compose(self) -> ComposeResult:
        """Pickers, slider, charts, figures."""
        with Horizontal(id="pickers"):
            yield Select[int]([], prompt="no run yet", id="run", compact=True)
            yield Select(list(zip(AXES, (0, 1), strict=True)), value=1, allow_blank=False, id="axis", compact=True)
            yield Select([(view, view) for view in VIEWS], value=VIEWS[0], allow_blank=False, id="view", compact=True)
        yield Slider("free run from ([ ])", "s", STEP_S, id="from")
        yield Chart(id="angle")
        yield Chart(id="error")
        yield Static(id="figures", markup=False)

    def missing(self) -> str:
        """A model and runs."""
        if not self.bench.runs:
            return NO_RUNS
        known = self.bench.model is not None and self.bench.model.is_file()
        return "" if known else "No model yet: identify one in step 4"

    def outcome(self) -> str:
        """How many runs were compared."""
        return counted_runs(len(self._comparisons)) if self._comparisons and self._of is not None else ""

    def enter(self) -> None:
        """Compare, if model or runs are not those compared last."""
        self._arrange()
        if self.missing():
            self._say(self.missing())
        elif self._of != self._subject():
            self.start_work()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Its job stays to answer, so it can always be started anew."""
        return True

    def start_work(self) -> None:
        """Compare the selected runs with the model."""
        model = self.bench.model
        if model is None:
            return
        self._of = self._subject()
        self._comparisons, self._free_runs = [], {}
        self._say("simulating")
        self.begin(tasks.compare, runs=list(self.bench.runs), model=model, out=self.bench.out / "report")

    def progressed(self, value: Any) -> None:
        """A compared run or one left out, a free run that was asked for, or a sentence."""
        if isinstance(value, Answer):
            self._free_runs[value.start] = value.free_run
            self._draw()
        elif isinstance(value, Note):
            self._draw(value.text)
            self.post_message(self.Done())
        elif isinstance(value, LeftOut):
            self.lab.mishap(RunError(value.why))
        else:
            self._comparisons.append(value)
            self._offer_runs()

    def ended(self, why: str) -> None:
        """No answers any more; what was compared stays."""
        self._of = None
        self._say(why)

    def action_cycle(self, what: str) -> None:
        """The next run, axis or view."""
        picker = self.query_one(f"#{what}", Select)
        options = {"run": range(len(self._comparisons)), "axis": range(len(AXES)), "view": VIEWS}[what]
        if len(options):
            here = options.index(picker.value) if picker.value in options else -1
            picker.value = options[(here + 1) % len(options)]
        next(chart for chart in self.query(Chart) if chart.display).focus()

    def action_start_at(self, steps: int) -> None:
        """Start the free run earlier or later."""
        self.query_one(Slider).action_move(steps)

    def show(self, comparisons: "list[Comparison]") -> None:
        """Draw these."""
        self._comparisons = list(comparisons)
        self._offer_runs()

    @on(Select.Changed)
    def _picked(self, event: Select.Changed) -> None:
        event.stop()
        if event.select.id == "run" and (shown := self._shown) is not None:
            slider = self.query_one(Slider)
            slider.maximum = STEP_S * int(max(shown.t[-1] - STEP_S, 0.0) / STEP_S)
            slider.value = 0.0
        self._draw()

    @on(Slider.Changed)
    def _moved(self, event: Slider.Changed) -> None:
        event.stop()
        run = self.query_one("#run", Select).value
        if self.job is None or not isinstance(run, int):
            return
        self._wanted = Start(run, event.slider.value)
        if self._wanted in self._free_runs:
            self._draw()
        else:
            self.job.ask(self._wanted)

    def on_resize(self, event: Resize) -> None:
        """A tall screen shows angle and error."""
        self._arrange()

    @property
    def _shown(self) -> "Comparison | None":
        run = self.query_one("#run", Select).value
        return self._comparisons[run] if isinstance(run, int) and run < len(self._comparisons) else None

    def _subject(self) -> tuple[Path, float, tuple[Path, ...]]:
        model = self.bench.model or Path()
        return model, model.stat().st_mtime, tuple(self.bench.runs)

    def _offer_runs(self) -> None:
        picker = self.query_one("#run", Select)
        here = picker.value if isinstance(picker.value, int) else 0
        picker.set_options([(_label(comparison), i) for i, comparison in enumerate(self._comparisons)])
        picker.value = min(here, len(self._comparisons) - 1)

    def _arrange(self) -> None:
        view = self.query_one("#view", Select).value
        tall = self.size.height >= TALL
        self.query_one("#angle", Chart).display = tall or view == VIEWS[0]
        self.query_one("#error", Chart).display = tall or view != VIEWS[0]

    def _draw(self, said: str = "") -> None:
        self._arrange()
        shown = self._shown
        if shown is None:
            return
        freely = self._free_run(shown)
        axis = 1 if self.query_one("#axis", Select).value == 1 else 0
        slider = self.query_one(Slider)
        slider.mark = freely.horizon_s
        horizon = [Mark(freely.horizon_s, f"horizon {freely.horizon_s:.2f} s")] if _ends_before(freely, shown) else []
        self._draw_angle(shown, freely, axis, horizon)
        self._draw_error(shown, freely, axis, horizon)
        self._say(_figures(shown) + (f"  {said}" if said else ""))

    def _free_run(self, shown: "Comparison") -> "FreeRun":
        """The free run from where the slider stands; the last one known while that is being simulated."""
        from dpr_lab.compare import FreeRun

        run = self._comparisons.index(shown)
        start = Start(run, self.query_one(Slider).value)
        return self._free_runs.get(start) or FreeRun(shown.t, shown.free_run, shown.horizon_s)

    def _draw_angle(self, shown: "Comparison", freely: "FreeRun", axis: int, marks: list[Mark]) -> None:
        measured = Series("measured", shown.t, shown.measured[:, axis])
        simulated = Series("free run", freely.t, freely.theta[:, axis], "secondary", dashed=True)
        self.query_one("#angle", Chart).show(
            [measured, simulated],
            x_label="time (s)",
            y_label=f"{AXES[axis]} (rad)",
            marks=marks,
            y_range=_range_of(shown.measured[:, axis]),
        )

    def _draw_error(self, shown: "Comparison", freely: "FreeRun", axis: int, marks: list[Mark]) -> None:
        noise = NOISE_SIGMAS * _MRAD * float(shown.noise_rad[axis])
        if self.query_one("#view", Select).value == VIEWS[1]:
            near = freely.t <= freely.horizon_s
            t = freely.t[near]
            error = shown.measured[-len(freely.t) :, axis][near] - freely.theta[near, axis]
        else:
            t, error, marks = shown.t, shown.segment_residual[:, axis], []
        self.query_one("#error", Chart).show(
            [Series("residual", t, _MRAD * error)],
            x_label="time (s)",
            y_label=f"{AXES[axis]} (mrad)",
            marks=marks,
            band=Band(-noise, noise, f"noise ±{NOISE_SIGMAS}σ"),
            x_range=(float(shown.t[0]), float(shown.t[-1])),
        )

    def _say(self, text: str) -> None:
        self.query_one("#figures", Static).update(text)


def _label(comparison: "Comparison") -> str:
    role = "held out" if comparison.held_out else "used"
    return f"{comparison.pose or ''} {comparison.run} ({role})".strip()


def _figures(comparison: "Comparison") -> str:
    """The numbers of `dpr-lab compare`'s table, inner and outer rod."""
    from dpr_lab.report.tables import COMPARISON_COLUMNS, comparison_rows

    row = dict(zip(COMPARISON_COLUMNS, comparison_rows([comparison])[0], strict=True))
    return (
        f"{row['role']}, {row['segments']} segments: rms {row['rms (mrad)']} mrad, noise {row['noise (mrad)']}"
        f" ({row['times noise']} times); free run from the release {row['free run (mrad)']} mrad up to"
        f" {row['horizon (s)']} s"
    )


def _ends_before(freely: "FreeRun", shown: "Comparison") -> bool:
    return freely.horizon_s < float(shown.t[-1])


def _range_of(angle: NDArray[np.float64]) -> tuple[float, float]:
    """The measurement's own range, so that a free run that tumbles away leaves the chart."""
    low, high = float(np.nanmin(angle)), float(np.nanmax(angle))
    room = max(0.06 * (high - low), 0.01)
    return low - room, high + room
