"""Step Diagnose: verdict, causes and location of the gap, gap reduction, and recommendations."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.widgets import Input, Label, Select, Static, TabbedContent, TabPane

from dpr_lab.errors import ConfigError
from dpr_lab.gap.result import RECORD
from dpr_lab.progress import FitBegan, ScoreTestBegan, StageBegan
from dpr_lab.shown import percent
from dpr_lab.tui.jobs import jobs
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.arm_results import start_of_diagnosis
from dpr_lab.tui.steps.diagnosis_views import far_view, next_view, which_view
from dpr_lab.tui.steps.job_step import READING
from dpr_lab.tui.steps.result_step import ResultStep
from dpr_lab.tui.texts import named_runs
from dpr_lab.tui.widgets.chart import Chart, Series
from dpr_lab.tui.widgets.run_browser import RunBrowser
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose

if TYPE_CHECKING:
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.gap.result.gap_size import Where

TABS = {"which": "Causes", "where": "Location", "far": "Gap reduction", "next": "Next steps"}

NONE_LEFT = (
    "every selected run is held out: hold out fewer runs ({diagnose.hold_out}), or select more runs ({app.browse})"
)


class DiagnoseStep(ResultStep["Diagnosis"]):
    """Diagnosis of the selected runs."""

    NAME = "Diagnose"
    PURPOSE = "shows where the simulation differs from the rig, which effect causes it, and with which probability"
    RESULT = "diagnosis"
    RESTS_ON = ("the rig", "the runs", "the held-out runs", "the model", "the torques")
    TYPICAL_S = 8.3  # sum of the stages, release of 10 s, on two cores
    HELP = """
Shows where the simulation differs from the rig, and which unmodelled effects cause the gap, with probabilities and
alternatives. Also shows by how much the gap decreases on held-out data, and what to record or measure next.

- **held out** (`{diagnose.hold_out}`): runs that are not fitted; they validate the named effects.
- **torques** (`{diagnose.torque}`): selects measured or commanded torques for runs that contain both.
- *Location* shows the torque or encoder error that would explain the gap, with its 90 % interval.
- Effects that these recordings cannot distinguish form one class and share its probability.

Report, figures, corrected model and `diagnosis.json` are written to `diagnosis/` in the folder of the workspace, as
`dpr-lab diagnose --out` writes them.
"""
    BINDINGS = bindings("diagnose")
    DEFAULT_CSS = """
    DiagnoseStep #form { height: 1; }
    DiagnoseStep #form Label { padding: 0 1 0 0; }
    DiagnoseStep #held-out { width: 1fr; max-width: 44; margin-right: 2; text-wrap: nowrap; text-overflow: ellipsis; }
    DiagnoseStep #form Input { width: 7; margin-right: 2; }
    DiagnoseStep #state { height: auto; max-height: 5; text-style: bold; }
    DiagnoseStep TabbedContent { height: 1fr; }
    DiagnoseStep TabPane { padding: 0; }
    DiagnoseStep #place { width: 100%; }
    DiagnoseStep #place-text { height: auto; max-height: 3; }
    """

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self._stage: StageBegan | None = None

    def compose(self) -> ComposeResult:
        """Build the form, the verdict, and the tabs with details."""
        with Horizontal(id="form"):
            yield Label("held out")
            yield Static(id="held-out", markup=False)
            yield Label("maximum number of effects")
            yield Input("4", id="max-effects", type="integer", compact=True)
            yield Label("seed")
            yield Input("0", id="seed", type="integer", compact=True)
        yield Static(id="state", markup=False)
        with TabbedContent(initial="which"):
            with TabPane(TABS["which"], id="which"), VerticalScroll():
                yield Static(id="which-text")
            with TabPane(TABS["where"], id="where"):
                yield Select[int]([], prompt="no diagnosis yet: nothing to locate", id="place", compact=True)
                yield Static(id="place-text", markup=False)
                place_map = Chart(id="place-map")
                place_map.display = False
                yield place_map
            for name in ("far", "next"):
                with TabPane(TABS[name], id=name), VerticalScroll():
                    yield Static(id=f"{name}-text")

    def outcome(self) -> str:
        """Return the short verdict for the list of steps."""
        if self.result is None:
            return ""
        named = len(self.result.effects)
        if self.result.verdict == "named":
            return f"{named} effect{'s' * (named > 1)} named"
        return self.result.verdict.replace("_", " ")

    def enter(self) -> None:
        """Show the held-out runs, and the diagnosis of the workspace."""
        self._show_held_out()
        if self.workspace.diagnosis not in (None, self._file) and self.job is None:
            from dpr_lab.gap.result.diagnosis import load_diagnosis

            self._file = self.workspace.diagnosis
            self.show(load_diagnosis(self._file))
        super().enter()

    def start_work(self) -> None:
        """Diagnose the selected runs."""
        runs = [run for run in self.workspace.runs if run not in self.workspace.held_out]
        if not runs:
            raise ConfigError(self.worded(NONE_LEFT))
        request = DiagnoseRequest(
            runs=tuple(runs),
            rig=self.workspace.rig,
            held_out=tuple(self.workspace.held_out),
            model=start_of_diagnosis(self.workspace.model),
            max_effects=self.whole_number("max-effects", 1, 8),
            seed=self.whole_number("seed"),
            torque=self.workspace.driven_by,
            out=self._record.parent,
        )
        self._stage = None
        self.say(READING)
        self.begin(jobs.workflow, job=diagnose, request=request)

    def progressed(self, value: Any) -> None:
        """Show the progress of the diagnosis."""
        match value:
            case StageBegan(number, of, name):
                self._stage = value
                self.say(f"{_progress(number, of)}: {name}")
            case FitBegan() | ScoreTestBegan() if self._stage is not None:
                from dpr_lab.report.words import in_words

                self.say(f"{_progress(self._stage.number, self._stage.of)}: {in_words(value.text)}")

    def finished(self, result: Any) -> None:
        """Show the diagnosis, which is already saved."""
        self.workspace.diagnosis = self._file = self._record
        self.query_one("#place", Select).clear()  # start at the first location
        self.show(result.diagnosis)
        self.changed()

    def report(self) -> Path | None:
        """Return the path of the report of the displayed diagnosis, or None without a diagnosis."""
        return self._file.with_name("diagnosis.html") if self._file is not None else None

    def action_hold_out(self) -> None:
        """Choose the held-out runs."""
        held_out, runs = self.workspace.held_out, self.workspace.runs
        browser = RunBrowser(self.services, held_out, runs, "Runs to hold out", take_here=False)
        self.app.push_screen(browser, self._hold_out)

    def action_place(self) -> None:
        """Show the next location of the gap."""
        self.query_one(TabbedContent).active = "where"
        picker = self.query_one("#place", Select)
        if self.result is not None and self.result.where and isinstance(picker.value, int):
            picker.value = (picker.value + 1) % len(self.result.where)

    def draw(self, diagnosis: "Diagnosis") -> str:
        """Draw all tabs; return the verdict."""
        from dpr_lab.gap.screen.pieces import uncut
        from dpr_lab.report.gap.tables import sentence
        from dpr_lab.report.words import in_words

        unit, file = self.workspace.unit, "DIAGNOSIS.json" if self._file is None else str(self._file)
        self.put("which-text", which_view(diagnosis, unit))
        self.put("far-text", far_view(diagnosis, unit))
        self.put("next-text", next_view(diagnosis, unit, file))
        picker, places = self.query_one("#place", Select), diagnosis.where
        number = picker.value if isinstance(picker.value, int) and picker.value < len(places) else 0
        picker.set_options(
            [
                (Content(f"{in_words(p.site)} by {p.coordinate}: {percent(p.share)} of the excess"), i)
                for i, p in enumerate(places)
            ]
        )
        picker.display = self.query_one("#place-map", Chart).display = bool(places)
        if places:
            picker.value = number
            self._draw_place(places[number])
        else:
            self.put("place-text", in_words(diagnosis.where_sentence))
        closed = diagnosis.gap.closed_held_out
        selected = {run.stem for run in (*self.workspace.runs, *self.workspace.held_out)}
        used = uncut((*closed.per_run, *closed.held_out), selected)
        return sentence(diagnosis) + self.of_other_runs(used, selected)

    @property
    def _record(self) -> Path:
        return self.workspace.out / "diagnosis" / RECORD

    def _hold_out(self, runs: list[Path] | None) -> None:
        if runs is not None:
            self.workspace.held_out = runs
            self._show_held_out()
            self.changed()

    def _show_held_out(self) -> None:
        self.put("held-out", named_runs(self.workspace.held_out) or "none")

    @on(Select.Changed, "#place")
    def _place_picked(self, event: Select.Changed) -> None:
        event.stop()
        if self.result is not None and isinstance(event.value, int) and event.value < len(self.result.where):
            self._draw_place(self.result.where[event.value])

    def _draw_place(self, place: "Where") -> None:
        from dpr_lab.report.envelope import signal_scale
        from dpr_lab.report.gap.tables import coordinate, place_map, quantity
        from dpr_lab.report.words import in_words

        unit = self.workspace.unit
        centres, value, reach = place_map(place, unit)
        edges = [
            Series("90 % interval" if sign < 0 else "", centres, value + sign * reach, "foreground") for sign in (-1, 1)
        ]
        zero = Series("", centres, np.zeros(len(centres)), "foreground")
        scale, clipped = signal_scale(value, reach)
        note = " Part of the curve is outside the plot." if clipped else ""
        self.put("place-text", in_words(place.sentence) + note)
        self.query_one("#place-map", Chart).show(
            [zero, *edges, Series("estimate", centres, value)],
            x_label=coordinate(place, unit)[0],
            y_label=quantity(place, unit)[0],
            y_range=scale,
        )


def _progress(number: int, of: int) -> str:
    return f"{'■' * (number - 1)}▣{'□' * (of - number)} step {number} of {of}"
