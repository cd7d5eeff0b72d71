"""Page of the documentation with the diagnoses of published recordings: its tables and texts."""

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from _real import Published, RealRig
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.causes import NamedEffect, nameable
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.report.gap.sizes import IN_MODELS, sizes_cell
from dpr_lab.rig import PARAMETERS
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class Fold:
    """One diagnosis of a real rig."""

    held_out: str
    fitted: list[Run]
    unseen: list[Run]
    diagnosis: Diagnosis
    seconds: float
    """CPU time of the diagnosis, s."""

    @property
    def closed(self) -> float:
        """Gap reduction on the held-out data, as a share."""
        return self.diagnosis.gap.closed_held_out.estimate

    @property
    def remainder(self) -> str:
        """Remainder that the verdict states, in units of the noise; empty if it states none."""
        stated = re.search(r"A remainder of (\S+) times the noise", self.diagnosis.sentence)
        return stated[1] if stated else ""

    @property
    def of_reproducible(self) -> float | None:
        """Explained share of the reproducible gap in the fitted recordings; None if unknown."""
        budget = self.diagnosis.gap.budget
        return budget.of_reproducible if budget else None


def diagnosed(real: RealRig) -> Iterator[Fold]:
    """Diagnose the rig once for each held-out recording."""
    for fitted, unseen in real.folds:
        start_s = time.process_time()
        diagnosis = diagnose(fitted, real.rig, held_out=unseen)
        of_single = "each quarter" if diagnosis.basis == "one release" else "every second part"
        yield Fold(unseen[0].name if unseen else of_single, fitted, unseen, diagnosis, time.process_time() - start_s)


def section(real: RealRig, folds: list[Fold]) -> str:
    """Write the section on one rig: effects, and comparison with the published model on the same held-out runs."""
    effects = [[fold.held_out, *row] for fold in folds for row in _effects(fold.diagnosis)]
    lines = [f"## {real.title}", "", real.known, "", *_table(_columns(EFFECT_COLUMNS), effects), ""]
    if real.published:
        ratio_rows, errors = list[list[str]](), dict[str, NDArray[np.float64]]()
        for fold in folds:
            rows, of_runs = _compared(real, fold, real.published)
            ratio_rows += [[fold.held_out, *row] for row in rows]
            errors |= of_runs
        caption = f"Rms error of the free run in rad. The published model contains {real.published.words}."
        error_rows = [[name, *_four(row)] for name, row in errors.items()]
        lines += [*_table(_columns(RATIO_COLUMNS), ratio_rows), "", caption, ""]
        lines += [*_table(_columns(ERROR_COLUMNS), error_rows), ""]
    return "\n".join(lines)


def summary(diagnoses: list[tuple[RealRig, list[Fold]]]) -> str:
    """Write a table with a row for every held-out recording, then the median and the worst of all."""
    rows = [
        [
            real.title,
            fold.held_out,
            fold.diagnosis.verdict.replace("_", " "),
            _percent(fold.closed),
            " to ".join(_percent(end) for end in fold.diagnosis.gap.closed_held_out.interval90),
            fold.remainder,
            "" if fold.of_reproducible is None else _percent(fold.of_reproducible),
            f"{fold.seconds:.0f}",
        ]
        for real, folds in diagnoses
        for fold in folds
    ]
    all_folds = [fold for _, folds in diagnoses for fold in folds]
    reproducible = [fold.of_reproducible for fold in all_folds if fold.of_reproducible is not None]
    closed, seconds = [fold.closed for fold in all_folds], [fold.seconds for fold in all_folds]
    for word, share, duration in (("median", np.median, np.median), ("worst", np.min, np.max)):
        explained = _percent(float(share(reproducible))) if reproducible else ""
        cells = ["", "", _percent(float(share(closed))), "", "", explained, f"{duration(seconds):.0f}"]
        rows.append([f"**{word}**", *cells])
    return "\n".join(["## Summary", "", *_table(_columns(SUMMARY_COLUMNS), rows), ""])


def _compared(
    real: RealRig, fold: Fold, published: Published
) -> tuple[list[list[str]], dict[str, NDArray[np.float64]]]:
    """Return rows of ratios, and errors of the free runs of the published, bare and corrected model, by recording."""
    _, unseen, _ = in_pieces(fold.fitted, fold.unseen)
    base = base_parameters([published.Z[name] for name in PARAMETERS], real.rig.L1, real.rig.g)
    diagnosis = fold.diagnosis
    estimate = Estimate.of(unknown_ratios(base), effect_params(published.effects), np.zeros((0, 4)))
    of_published = free_runs(Recordings(tuple(record(run, real.rig) for run in unseen), real.rig), estimate).errors_rad
    names = [run.name for run in unseen if run.name in diagnosis.gap.free_run_rad]
    errors = {name: np.array([of_published[name], *diagnosis.gap.free_run_rad[name].values()]) for name in names}
    return _ratios(diagnosis, ratios(base)), errors


def _four(values: NDArray[np.float64]) -> list[str]:
    return [f"{value:.4f}" for value in values.tolist()]


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def _ratios(diagnosis: Diagnosis, published: Any) -> list[list[str]]:
    return [
        [name, f"{ratio.value:.5g}", f"[{ratio.interval90[0]:.5g}, {ratio.interval90[1]:.5g}]", f"{value:.5g}"]
        for name, value in zip(RATIOS, published.tolist(), strict=True)
        for ratio in (diagnosis.all_ratios[name],)
    ]


def _effects(diagnosis: Diagnosis) -> Iterator[list[str]]:
    """Yield a row for each effect of the corrected model; one row without an effect if there are none."""
    for effect in diagnosis.effects:
        named = effect.name in diagnosis.sentence
        others = str(len(nameable(effect.members, effect.odds)) - 1) if named else ""
        withdrawn = "yes" if effect.name in diagnosis.withdrawn else "no"
        probability, share = _percent(effect.probability), _percent(effect.share)
        yield [EFFECTS[effect.name].words, others, withdrawn, probability, share, _size(diagnosis, effect)]
    if not diagnosis.effects:
        yield ["none", "", "", "", "", ""]


def _size(diagnosis: Diagnosis, effect: NamedEffect) -> str:
    """Size of an effect with at most two parameters, as ratio if b is unknown; otherwise the number of parameters."""
    if len(effect.parameters) > 2:
        return f"{len(effect.parameters)} values"
    parts = sizes_cell(diagnosis, effect).split("; ")
    return "; ".join(part for part in parts if part.endswith(")") and not part.startswith(("assuming", IN_MODELS)))


def _columns(names: str) -> list[str]:
    return names.split(" | ")


SUMMARY_COLUMNS = (
    "rig | held-out recording | verdict | gap reduction on held-out data | 90 % interval | remainder, times the noise"
    " | explained share of the reproducible gap | CPU time, s"
)
EFFECT_COLUMNS = (
    "held-out recording | effect | number of indistinguishable effects | withdrawn | probability"
    " | unique contribution | size (90 % interval)"
)
RATIO_COLUMNS = "held-out recording | ratio | estimate | 90 % interval | published"
ERROR_COLUMNS = "recording | published model | bare model | corrected model"

HEAD = """# Diagnoses of real rigs

This page lists 27 diagnoses of recordings that other laboratories published. You can repeat them with
`benchmarks/real.py`.

- *Held-out data.* If a rig has several recordings, each recording is held out once and predicted from the others. A
  single recording is divided: every second part is held out. Of a short recording, each quarter is predicted from the
  other quarters.
- *Reproducible gap.* This is the part of the gap that free-form corrections of torques and readings remove
  ([Reading the report](reading-the-report.md)). It is computed on the fitted recordings. Even if the
  explained share is 100 %, a remainder is left that differs from recording to recording.
- *Remainder.* If it exceeds the noise, a further cause acts, or a named effect has another form.
- *Withdrawn* effects explain the fitted recordings but do not carry over to the held-out recording. For withdrawn and
  small effects, the number of indistinguishable effects is not stated.
- *Size.* If an effect has more than two parameters, their number is stated. b and a are the inertias of the outer and
  of the inner rod; a ratio to them is stated if the scale is not known.
- *Published model.* It is simulated with the parameters of its authors, from the same initial states as the bare and
  the corrected model.
- *Intervals.* An interval assumes that the corrected model is complete. If friction of the rig is missing in it, the
  published ratio can lie outside the interval.
"""

OPEN = """## Limits of these diagnoses

- For the rigs with one rod, only a length and a mass are known. Their rig files were drafted with `dpr-lab rig new`.
- The remainders of the driven recordings are the largest ([Driven rigs](benchmarks/parameters.md#driven-rigs)).
"""
