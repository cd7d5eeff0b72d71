"""Tables of the publication with printed and recomputed values, and conclusions."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.paper.campaign import TRUTHS, SearchResult, ratio_percent
from dpr_lab.paper.printed import BEST_H, POSES, TABLE_1, TABLE_2, TABLE_3, TRUE
from dpr_lab.paper.swings import READINGS, TERMS, errors, swings
from dpr_lab.rig import PARAMETERS, Rig


@dataclass(frozen=True, slots=True)
class PaperTable:
    """Table of text cells with its title and column heads."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Recomputed:
    """Recomputed values of E for the printed rows of parameters."""

    table1: dict[str, Array]
    """(7, 3) E of the rows of Table 1 from the three poses, by the name of its interpretation in `TERMS`."""
    table3: dict[str, Array]
    """(10, 3) E of the rows of Table 3 from the three poses, by the name of its interpretation in `TERMS`."""


def recompute(rig: Rig) -> Recomputed:
    """Compute E for the rows of Tables 1 and 3."""
    truth = swings(TRUE, rig)
    return Recomputed(*(_by_term([errors(row[:9], truth, rig) for row in table]) for table in (TABLE_1, TABLE_3)))


def all_tables(ours: Recomputed, results: Sequence[SearchResult], rig: Rig) -> list[PaperTable]:
    """Build all tables of the reproduction, in the order of the publication."""
    return [
        table1(ours),
        table2(ours),
        table3(ours, rig),
        searches(results, rig),
        parameters(results),
        ratios(results, rig),
    ]


def table1(ours: Recomputed) -> PaperTable:
    """Build table 1: E of seven sets of parameters in every interpretation."""
    rows = [
        (str(i + 1), _digits(printed), *(_digits(ours.table1[term][i, 0]) for term in TERMS))
        for i, printed in enumerate(TABLE_1[:, -1])
    ]
    return PaperTable("table1", "Table 1: E(Z) from X1", ("row", "printed", *TERMS), tuple(rows))


def table2(ours: Recomputed) -> PaperTable:
    """Build table 2: E of groups 1, 4 and 6 for three poses and all interpretations."""
    rows = [
        (
            str(int(group)),
            pose,
            _digits(row[k]),
            *(_digits(ours.table1[term][int(group) - 1, k]) for term in TERMS),
        )
        for group, *row in TABLE_2.tolist()
        for k, pose in enumerate(POSES)
    ]
    return PaperTable("table2", "Table 2: E(Z) by pose", ("group", "pose", "printed", *TERMS), tuple(rows))


def table3(ours: Recomputed, rig: Rig) -> PaperTable:
    """Build table 3: H and parameter errors of the ten printed rows, in several interpretations."""
    angles, speeds = ours.table3["angles"], ours.table3["angles and speeds"]
    columns = (
        "row",
        "printed H",
        "X1",
        "min",
        "max",
        "sum",
        "sum with speeds",
        "largest error of the nine, %",
        "largest error of the ratios, %",
    )
    rows = [
        (
            str(i + 1),
            f"{row[-1]:g}",
            *(_digits(H) for H in (angles[i, 0], angles[i].min(), angles[i].max(), angles[i].sum(), speeds[i].sum())),
            _digits(np.abs(100 * (row[:9] / TRUE - 1)).max()),
            _digits(np.abs(ratio_percent(row[:9], TRUE, rig)).max()),
        )
        for i, row in enumerate(TABLE_3)
    ]
    return PaperTable("table3", "Table 3: printed rows, H recomputed (angles unless stated)", columns, tuple(rows))


def searches(results: Sequence[SearchResult], rig: Rig) -> PaperTable:
    """Build the table of the repeated searches: H, and errors of parameters and ratios."""
    columns = (
        "H",
        "grid",
        "seed",
        "best H",
        "≤ printed",
        "largest error of the nine, %",
        "largest error of the ratios, %",
        "step (4) from",
        "cpu s",
    )
    rows = [
        (
            *_head(f),
            _digits(f.H),
            "yes" if f.as_good_as_printed else "no",
            _digits(np.abs(f.percent).max()),
            _digits(np.abs(f.ratio_percent(rig)).max()),
            "never" if f.gate_opened is None else str(f.gate_opened),
            f"{f.cpu_s:.1f}",
        )
        for f in results
    ]
    return PaperTable("searches", f"Our searches (the paper's best H is {BEST_H})", columns, tuple(rows))


def parameters(results: Sequence[SearchResult]) -> PaperTable:
    """Build the table of the errors of the nine parameters in each search, %."""
    rows = [(*_head(f), *_signed(f.percent)) for f in results]
    return PaperTable("parameters", "Errors of the nine parameters, %", ("H", "grid", "seed", *PARAMETERS), tuple(rows))


def ratios(results: Sequence[SearchResult], rig: Rig) -> PaperTable:
    """Build the table of the errors of the five ratios in each search, %."""
    rows = [(*_head(f), *_signed(f.ratio_percent(rig))) for f in results]
    return PaperTable("ratios", "Errors of the five ratios, %", ("H", "grid", "seed", *RATIOS), tuple(rows))


def verdicts(results: Sequence[SearchResult], rig: Rig) -> list[str]:
    """Describe the agreement with the publication in sentences.

    There is one sentence for each grid and for each interpretation of the objective H.
    """
    return [
        _verdict(reading, grid, group, rig)
        for reading in READINGS
        for grid in TRUTHS
        if (group := [f for f in results if (f.case.reading, f.case.grid) == (reading, grid)])
    ]


def _verdict(reading: str, grid: str, group: Sequence[SearchResult], rig: Rig, within_percent: float = 1.0) -> str:
    """State how many searches of a group reach the published H, and how many the published accuracy."""
    costs = [f.H for f in group]
    nine = sum(bool((np.abs(f.percent) <= within_percent).all()) for f in group)
    five = sum(bool((np.abs(f.ratio_percent(rig)) <= within_percent).all()) for f in group)
    n = len(group)
    return (
        f"H = {reading} ({READINGS[reading].why}), true values {grid} the coding grid: H ≤ {BEST_H} is reached in"
        f" {sum(f.as_good_as_printed for f in group)} of {n} seeds (best {_digits(min(costs))},"
        f" worst {_digits(max(costs))}); all nine parameters within {within_percent:g} % in {nine} of {n},"
        f" all five ratios in {five} of {n}."
    )


def _head(search: SearchResult) -> tuple[str, str, str]:
    return search.case.reading, search.case.grid, str(search.case.seed)


def _signed(percent: Iterable[float]) -> tuple[str, ...]:
    return tuple(f"{value:+.2f}" for value in percent)


def _by_term(rows: Sequence[dict[str, Array]]) -> dict[str, Array]:
    return {term: np.array([row[term] for row in rows]) for term in TERMS}


def _digits(value: float) -> str:
    return f"{value:.4g}"
