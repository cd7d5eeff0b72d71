"""Step 6: why simulation and rig differ; the verdict first, then where, which, how far, and what to do next."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import Input, Label, Select, Static, TabbedContent, TabPane

from dpr_lab.errors import ConfigError, RunError
from dpr_lab.tui import tasks
from dpr_lab.tui.chart import Chart, Series
from dpr_lab.tui.runs import RunBrowser
from dpr_lab.tui.tasks import Stage
from dpr_lab.tui.texts import Bars, named_runs, sentences, table
from dpr_lab.tui.working import MOST_SEED, NO_RUNS, WorkingStep, work_keys

if TYPE_CHECKING:
    from dpr_lab.gap.diagnosis import Diagnosis, Where

TABS = {"which": "Which", "where": "Where", "far": "How far", "next": "What next"}
FILE = "diagnosis.json"

_MRAD = 1e3


class DiagnoseStep(WorkingStep):
    """Runs in, a diagnosis out."""

    NAME = "Diagnose"
    WORK = "the diagnosis that is running"
    HELP = """
Says where the simulation still differs from the rig, which unmodelled effect causes it, how sure that is, what else it
could be, how much of the gap closes on data not used for the fit, and what to record or measure next.

- **held out** (`h`): runs that take no part and only measure how far the gap closes.
- *Where* shows the torque or encoder error that would explain the gap, with its 90 % interval.
- Effects that these recordings cannot tell apart are one class and share its probability.

Report, figures, corrected model and `diagnosis.json` are written to `diagnosis/` in the bench's folder, as
`dpr-lab diagnose --out` writes them.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        *(key for key in work_keys("diagnose") if key.action in ("start", "cancel")),
        Binding("h", "hold_out", "Hold out", id="diagnose.hold_out"),
        Binding("v", "view", "View", id="diagnose.view"),
        Binding("o", "place", "Next place", id="diagnose.place"),
    ]
    DEFAULT_CSS = """
    DiagnoseStep #form { height: 1; }
    DiagnoseStep #form Label { padding: 0 1 0 0; }
    DiagnoseStep #held-out { width: 1fr; max-width: 44; margin-right: 2; text-wrap: nowrap; text-overflow: ellipsis; }
    DiagnoseStep #form Input { width: 7; margin-right: 2; }
    DiagnoseStep #state { height: auto; max-height: 5; text-style: bold; }
    DiagnoseStep TabbedContent { height: 1fr; }
    DiagnoseStep TabPane { padding: 0; }
    DiagnoseStep #place { width: 100%; }
    DiagnoseStep #place-said { height: auto; max-height: 3; }
    """

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._shown: Path | None = None
        self._found: Diagnosis | None = None

    def compose(self) -> ComposeResult:
        """The form, the verdict, and the rest in tabs."""
        with Horizontal(id="form"):
            yield Label("held out")
            yield Static(id="held-out", markup=False)
            yield Label("effects at most")
            yield Input("4", id="max-effects", type="integer", compact=True)
            yield Label("seed")
            yield Input("0", id="seed", type="integer", compact=True)
        yield Static(id="state", markup=False)
        with TabbedContent(initial="which"):
            with TabPane(TABS["which"], id="which"), VerticalScroll():
                yield Static(id="which-text")
            with TabPane(TABS["where"], id="where"):
                yield Select[int]([], prompt="no place", id="place", compact=True)
                yield Static(id="place-said", markup=False)
                yield Chart(id="place-map")
            for name in ("far", "next"):
                with TabPane(TABS[name], id=name), VerticalScroll():
                    yield Static(id=f"{name}-text")

    def missing(self) -> str:
        """Runs; a model is not needed."""
        return "" if self.bench.runs else NO_RUNS

    def outcome(self) -> str:
        """The verdict in two words."""
        return self._found.verdict.replace("_", " ") if self._found is not None else ""

    def enter(self) -> None:
        """Show what is held out, and the bench's diagnosis."""
        self._show_held_out()
        if self.bench.diagnosis not in (None, self._shown) and self.job is None:
            self._shown = self.bench.diagnosis
            self.show(load_diagnosis(self._shown))

    def start_work(self) -> None:
        """Diagnose the selected runs."""
        runs = [run for run in self.bench.runs if run not in self.bench.held_out]
        if not runs:
            raise ConfigError("every selected run is held out: hold out fewer (h), or select more (b)")
        arguments = {
            "max_effects": self.whole_number("max-effects", 1, 8),
            "seed": self.whole_number("seed", 0, MOST_SEED),
        }
        self._say("reading the runs")
        self.begin(
            tasks.diagnose,
            runs=runs,
            held_out=list(self.bench.held_out),
            rig=self.bench.rig,
            model=self.bench.model,
            out=self.bench.out / "diagnosis",
            **arguments,
        )

    def progressed(self, value: Any) -> None:
        """What is being done."""
        if isinstance(value, Stage):
            done = "■" * (value.number - 1) + "▣" + "□" * (value.of - value.number)
            self._say(f"{done} step {value.number} of {value.of}: {value.text}")

    def finished(self, result: Any) -> None:
        """The diagnosis, saved already."""
        self.bench.diagnosis = self._shown = self.bench.out / "diagnosis" / FILE
        self.show(result)
        self.post_message(self.Done())

    def ended(self, why: str) -> None:
        """Without a diagnosis; the one from before is still there."""
        self._say(f"ended without a diagnosis: {why}")

    def action_view(self) -> None:
        """The next tab."""
        self.show_next_tab()

    def action_hold_out(self) -> None:
        """Choose the runs that take no part."""
        bench = self.bench
        browser = RunBrowser(bench.out / "runs", bench.held_out, bench.runs, "Runs to hold out")
        self.app.push_screen(browser, self._hold_out)

    def action_place(self) -> None:
        """The next place in which the gap can lie."""
        self.query_one(TabbedContent).active = "where"
        picker = self.query_one("#place", Select)
        if self._found is not None and self._found.where and isinstance(picker.value, int):
            picker.value = (picker.value + 1) % len(self._found.where)

    def show(self, found: "Diagnosis") -> None:
        """Draw a diagnosis: the verdict, and the rest in tabs."""
        self._found = found
        self._say(found.sentence + self._doubt(found))
        self.query_one("#which-text", Static).update(_which(found))
        self.query_one("#far-text", Static).update(_far(found))
        self.query_one("#next-text", Static).update(_next(found))
        picker = self.query_one("#place", Select)
        picker.set_options(
            [(f"{p.site} by {p.coordinate}: {p.share:.0%} of the excess", i) for i, p in enumerate(found.where)]
        )
        if found.where:
            picker.value = 0
            self._draw_place(found.where[0])
        else:
            self.query_one("#place-said", Static).update(found.where_sentence)

    def _hold_out(self, runs: list[Path] | None) -> None:
        if runs is not None:
            self.bench.held_out = runs
            self._show_held_out()
            self.post_message(self.Done())

    def _show_held_out(self) -> None:
        self.query_one("#held-out", Static).update(named_runs(self.bench.held_out) or "none")

    def _doubt(self, found: "Diagnosis") -> str:
        """Said where the diagnosis is of other runs than those selected."""
        closed = found.gap.closed_held_out
        selected = {run.stem for run in (*self.bench.runs, *self.bench.held_out)}
        same = {*closed.per_run, *closed.held_out} == selected
        return "" if same or not selected else " This diagnosis is of other runs than those selected now."

    @on(Select.Changed, "#place")
    def _place_picked(self, event: Select.Changed) -> None:
        event.stop()
        if self._found is not None and isinstance(event.value, int) and event.value < len(self._found.where):
            self._draw_place(self._found.where[event.value])

    def _draw_place(self, place: "Where") -> None:
        from dpr_lab.report.gap_tables import COORDINATES, QUANTITIES, place_map

        at, value, reach = place_map(place)
        edges = [
            Series("90 % interval" if sign < 0 else "", at, value + sign * reach, "foreground", dashed=True)
            for sign in (-1, 1)
        ]
        zero = Series("", at, np.zeros(len(at)), "foreground")
        self.query_one("#place-said", Static).update(place.sentence)
        self.query_one("#place-map", Chart).show(
            [zero, *edges, Series("estimate", at, value)],
            x_label=COORDINATES.get(place.coordinate, place.coordinate),
            y_label=QUANTITIES.get(place.unit, (place.unit, 1.0))[0],
        )

    def _say(self, text: str) -> None:
        self.query_one("#state", Static).update(text)

    @on(Input.Submitted)
    def _given(self) -> None:
        self.focus()


def load_diagnosis(path: Path) -> "Diagnosis":
    """Read `diagnosis.json`.

    Raises:
        RunError: not there, not JSON, or not a diagnosis; the message names the key.
    """
    from pydantic import ValidationError

    from dpr_lab.gap.diagnosis import Diagnosis

    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        kept = {key: told[key] for key in told if key != "files"} if isinstance(told, dict) else told
        return Diagnosis.model_validate(kept)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RunError(f"{path}: is not a diagnosis that this dpr-lab wrote: {key}: {first['msg']}") from error
    except ValueError as error:
        raise RunError(f"{path}: is not a diagnosis (JSON): {error}") from error


def _which(found: "Diagnosis") -> Group:
    """Named effects with their probabilities and twins, what else each can be, sensor faults."""
    from dpr_lab.report import gap_tables

    others = {name: p for name, p in found.probabilities.items() if name in ("no_gap", "unexplained")}
    shown: list[RenderableType] = [_effect(row) for row in gap_tables.effect_rows(found)] or ["No effect is named.\n"]
    shown.append("  ".join(f"{name.replace('_', ' ')}: {p:.0%}" for name, p in others.items()))
    if rows := gap_tables.standing_rows(found):
        shown += ["", table("How sure that is", gap_tables.STANDING_COLUMNS, rows, prose=True)]
        shown.append(Text(gap_tables.STANDING_NOTE, "dim"))
    if found.sensor_findings:
        rows = gap_tables.finding_rows(found)
        shown += ["", table("Sensor faults", gap_tables.FINDING_COLUMNS, rows, prose=True)]
    return Group(*shown)


def _effect(row: Sequence[str]) -> Text:
    """A named effect: how sure, its twins, its size with 90 % intervals."""
    name, twins, probability, share, parameters = row
    text = Text(name, "bold").append(
        f": probability {probability}, {share} of the excess comes back without it\n", "not bold"
    )
    text.append(f"    cannot be told from: {twins}\n", "not bold")
    return text.append(f"    90 % interval: {parameters}\n", "not bold")


def _far(found: "Diagnosis") -> Group:
    """The gap as effects are added, and the share that closes on data not used for the fit."""
    from dpr_lab.report import gap_tables
    from dpr_lab.report.digits import three

    gap, closed = found.gap, found.gap.closed_held_out
    floor = _MRAD * float(np.linalg.norm(list(gap.floor_rad.values())))
    steps = [
        (name, _MRAD * left, None, f"{said}, {explained}")
        for (name, left), (_, said, explained) in zip(gap_tables.steps(found), gap_tables.step_rows(found), strict=True)
    ]
    shares = [("all runs", closed.estimate, closed.interval90), *((run, s, None) for run, s in closed.per_run.items())]
    shares += [(f"{run} (held out)", share, None) for run, share in closed.held_out.items()]
    low, high = closed.interval90
    return Group(
        "Gap left (mrad rms, both joints, segments of 0.5 s) and share of the excess explained, one effect after the"
        f" other; ┊ is the noise floor, {three(floor)}",
        Bars(steps, mark=floor),
        f"\nOn releases that took no part in the fit {closed.estimate:.1%} of the gap above the noise closes (90 %"
        f" interval {low:.1%} to {high:.1%})",
        Bars([(name, max(share, 0.0), interval, f"{share:.1%}") for name, share, interval in shares], top=1.0),
        "",
        table("Free runs from the release", gap_tables.CLOSED_COLUMNS, gap_tables.closed_rows(found)),
    )


def _next(found: "Diagnosis") -> Group:
    """What to do, what would have been seen, what was taken for granted."""
    from dpr_lab.report import gap_tables

    return Group(
        sentences("What to do next", gap_tables.next_steps(found), numbered=True),
        table(
            "What these recordings would show",
            gap_tables.DETECTABLE_COLUMNS,
            gap_tables.detectable_rows(found),
            prose=True,
        ),
        sentences("Assumptions", found.assumptions),
    )
