"""Step Identify: identification of a model, with a live plot of the convergence.

The search can be stopped with its best result so far.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group
from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.widgets import Input, Label, Select, Static, TabbedContent, TabPane

from dpr_lab.errors import DprError
from dpr_lab.progress import GenerationDone, LocalFitBegan
from dpr_lab.shown import counted
from dpr_lab.tui.jobs import jobs
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.job_step import READING
from dpr_lab.tui.steps.result_step import ResultStep
from dpr_lab.tui.texts import named_runs, report_table, sentences
from dpr_lab.tui.widgets.chart import Chart, Series
from dpr_lab.workflows.events import RunRead
from dpr_lab.workflows.identify import IdentifyRequest

if TYPE_CHECKING:
    from dpr_lab.identification.model import Model
    from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel

TABS = ("convergence", "ratios", "nine", "seen")


class IdentifyStep(ResultStep["AnyModel"]):
    """Identification of the selected runs; writes model.json."""

    NAME = "Identify"
    PURPOSE = "estimates the parameters of the rig from these runs, inside the bounds of its file"
    RESULT = "identification"
    RESTS_ON = ("the rig", "the runs", "the torques")
    CAN_STOP = True
    HELP = """
Estimates the parameters of the rig from the selected runs: a global search inside the bounds of the rig file, then a
local fit down to the noise floor.

- **objective** `segments` restarts the simulation every quarter second, so that chaos does not disturb the search;
  `paper` simulates each record in one piece from the release, and adds the squared errors of all angles and speeds,
  which the publication calls E(Z).
- **search** is the search algorithm; **seed** makes its result repeatable.
- **torques** (`{identify.torque}`): selects measured or commanded torques for runs that contain both.
- A search that is stopped early continues with the local fit from its best individual. A cancelled search has no
  result.

A free swing determines only ratios. *Nine parameters* (*Parameters* for a single rod, *Absolute values* with a free or
driven arm) shows the values in SI units, and which data determine each value. *Identifiability* shows what the
recordings do not determine, and which measurements help. With a free or driven arm, a local fit estimates the ratios of
rods, arm and drive. This fit starts from the values of the rig file. The model is written to `model.json` in the folder
of the workspace.
"""
    BINDINGS = bindings("identify")
    DEFAULT_CSS = """
    IdentifyStep #runs { height: 1; text-wrap: nowrap; text-overflow: ellipsis; }
    IdentifyStep .form { height: 1; }
    IdentifyStep .form Label { padding: 0 1 0 0; }
    IdentifyStep .form Select { width: 48; margin-right: 2; }
    IdentifyStep .form Input { width: 8; }
    IdentifyStep #state { height: auto; max-height: 4; }
    IdentifyStep TabbedContent { height: 1fr; }
    IdentifyStep TabPane { padding: 0; }
    IdentifyStep Chart { width: 1fr; }
    """

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self._history: list[GenerationDone] = []

    def compose(self) -> ComposeResult:
        """Build the form, the progress display and the tabs of results."""
        from dpr_lab.identification.objectives import OBJECTIVES, objective_words
        from dpr_lab.search import ALGORITHMS, search_words

        yield Static(id="runs", markup=False)
        with Horizontal(classes="form"):
            yield Label("objective")
            yield _choice("objective", {name: objective_words(name) for name in OBJECTIVES})
        with Horizontal(classes="form"):
            yield Label("search   ")
            yield _choice("search", {name: search_words(name) for name in ALGORITHMS})
            yield Label("seed")
            yield Input("0", id="seed", type="integer", compact=True, select_on_focus=False)
        yield Static(id="state", markup=False)
        with TabbedContent(initial=TABS[0]):
            with TabPane("Convergence", id=TABS[0]), Horizontal():
                yield Chart(id="cost")
                yield Chart(id="fitness")
            for name, title in zip(TABS[1:], ("Ratios", "Nine parameters", "Identifiability"), strict=True):
                with TabPane(title, id=name), VerticalScroll():
                    yield Static(id=f"{name}-text")

    def outcome(self) -> str:
        """Return the number of fitted runs as text."""
        if self.workspace.model is None:
            return ""
        return f"model of {counted(len(self.result.runs), 'run')}" if self.result is not None else "model"

    def enter(self) -> None:
        """Show the workspace's runs and its model."""
        self.put("runs", named_runs(self.workspace.runs) or self.missing())
        if self.workspace.model not in (None, self._file) and self.job is None:
            from dpr_lab.identification.moving_arm.model import load_model

            self._file = self.workspace.model
            self.show(load_model(self._file))
        super().enter()

    def start_work(self) -> None:
        """Identify the selected runs."""
        request = IdentifyRequest(
            runs=tuple(self.workspace.runs),
            rig=self.workspace.rig,
            out=self.workspace.out / "model.json",
            objective=str(self.query_one("#objective", Select).value),
            search=str(self.query_one("#search", Select).value),
            seed=self.whole_number("seed"),
            torque=self.workspace.driven_by,
        )
        self._history = []
        self._draw_convergence()
        self.say(READING)
        self.query_one(TabbedContent).active = TABS[0]
        self.begin(jobs.identify, request=request)

    def progressed(self, value: Any) -> None:
        """Show a run that was read, a finished generation, or the end of the search."""
        match value:
            case RunRead(notes=notes):
                for note in notes:
                    self.say(f"{value.name}: {note}")
            case GenerationDone():
                self._history.append(value)
                self.say(self._standing(value))
                self._draw_convergence()
            case LocalFitBegan():
                self.say("search finished; the local fit follows")

    def finished(self, result: Any) -> None:
        """Show the model of a finished job, which is already saved."""
        self.workspace.model = self._file = result.file
        self.show(result.model)
        self.query_one(TabbedContent).active = TABS[1]
        self.changed()
        if result.model.failures:
            failed = "; ".join(result.model.failures).rstrip(".")
            raise DprError(f"{failed}. The model was written to {result.file}, but it is not reliable")

    def action_stop(self) -> None:
        """End the search and keep its best result."""
        super().action_stop()
        self.say("stopping after this generation; the local fit starts from its best individual")

    def draw(self, model: "AnyModel") -> str:
        """Draw a model: convergence, values, and the data that determine each value; return its summary."""
        from dpr_lab.identification.model import Model

        title = "Absolute values"
        if isinstance(model, Model):
            title = "Parameters" if model.fitted else "Nine parameters"
        self.query_one(TabbedContent).get_tab("nine").label = title
        summary = self._draw_rods(model) if isinstance(model, Model) else self._draw_arm(model)
        used, selected = {Path(run.file).name for run in model.runs}, {run.name for run in self.workspace.runs}
        return summary + self.of_other_runs(used, selected)

    def _draw_arm(self, model: "MovingArmModel") -> str:
        """Draw the model of a rig with a moving arm, which usually needs no search."""
        from dpr_lab.report import moving_arm
        from dpr_lab.tui.steps import arm_results

        arm_results.draw_merges(model, self.query_one("#cost", Chart), self.query_one("#fitness", Chart))
        self.put("ratios-text", arm_results.ratios(model))
        self.put("nine-text", arm_results.absolute(model))
        self.put("seen-text", arm_results.identifiability(model))
        return f"{moving_arm.summary(model, self.workspace.unit)}."

    def _draw_rods(self, model: "Model") -> str:
        """Draw the model of the rods on a clamped or prescribed arm."""
        from dpr_lab.report import tables

        self._history = _history(model)
        self._draw_convergence()
        warnings = sentences("Warnings", [*model.failures, *model.warnings], mark="!")
        ratios = report_table(tables.ratio_title(model), tables.ratio_table(model))
        absolute = tables.base_table(model)
        base = [report_table(tables.BASE_TITLE, absolute)] * bool(absolute)
        count = "Parameters" if model.fitted else "Nine parameters"
        nine = report_table(f"{count} and what determines them", tables.parameter_table(model))
        self.put("ratios-text", Group(ratios, Text(tables.ratio_note(model), "dim"), *base, warnings))
        self.put("nine-text", Group(nine, Text(tables.parameter_note(model), "dim")))
        self.put("seen-text", _identifiability(model))
        return tables.summary(model, angles=self.workspace.unit)

    def _standing(self, last: GenerationDone) -> str:
        return (
            f"generation {last.number} of at most {last.at_most}, {last.evaluations} evaluations,"
            f" best cost {last.best_cost:.4g}, population fitness {last.population_fitness:.3f}"
        )

    def _draw_convergence(self) -> None:
        shown = [
            generation for generation in self._history if generation.best_cost > 0 and np.isfinite(generation.best_cost)
        ]
        number = np.array([generation.number for generation in shown], dtype=np.float64)
        cost = np.log10([generation.best_cost for generation in shown])
        fitness = np.array([generation.population_fitness for generation in shown])
        self.query_one("#cost", Chart).show([Series("best", number, cost)], x_label="generation", y_label="log10 cost")
        self.query_one("#fitness", Chart).show(
            [Series("population", number, fitness, "secondary")],
            x_label="generation",
            y_label="fitness",
            y_range=(0.0, 1.05),
        )


def _history(model: "Model") -> list[GenerationDone]:
    names = ("evaluations", "best_cost", "best_fitness", "population_fitness")
    columns = [model.search.history.get(name, []) for name in names]
    return [
        GenerationDone(number, model.search.generations, int(evaluations), *values)
        for number, (evaluations, *values) in enumerate(zip(*columns, strict=False))
    ]


def _identifiability(model: "Model") -> Group:
    """Draw the identifiable parameters, and the recommended bench measurements."""
    from dpr_lab.identification.directions import described

    identifiability = model.identifiability
    if identifiability is None:
        return Group("This model contains no identifiability analysis.")
    free = [described(direction) for direction in identifiability.null_space]
    return Group(
        f"The recordings determine {identifiability.rank} of {len(model.mounted)} combinations of parameters.\n",
        sentences("Parameter changes that neither recordings nor measured values can detect:", free),
        sentences("Additional measurements on the bench, best first:", identifiability.advice),
        "" if free else "All parameters are determined. A further measurement only reduces their uncertainty.",
    )


def _choice(name: str, options: dict[str, str]) -> Select[str]:
    worded = [(Content(words), option) for option, words in options.items()]
    return Select(worded, value=next(iter(options)), allow_blank=False, id=name, compact=True)
