"""Write the HTML report of a diagnosis: verdict, gap budget and causes, then folded sections."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from dpr_lab.acceptance.judge import Acceptance
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.gap import check_tables, tables
from dpr_lab.report.gap.acceptance import RULE, answer_sentence, deciding_sentence, limit_note, limit_table
from dpr_lab.report.gap.findings import finding_table
from dpr_lab.report.gap.next_steps import next_steps
from dpr_lab.report.gap.section import evidence_blocks
from dpr_lab.report.gap.sections import SECTIONS
from dpr_lab.report.gap.sections.closing import CLOSING
from dpr_lab.report.gap.sizes import IN_MODELS, assumed, scale_note
from dpr_lab.report.gap.summary import budget_bar, repeatability_bar, repeatability_sentences, summary_note
from dpr_lab.report.gap.trials_of_search import trial_table
from dpr_lab.report.pages.page import Block, Heading, Items, PageTable, Section, page_html, pictures, write_page
from dpr_lab.report.words import in_words

FIGURES = {
    "where": (
        "Line charts of torque or encoder error against joint angle, speed, time or load.",
        "Torque or encoder error that would explain the gap, with 90 % intervals. Effects of the ratios and of the"
        " initial states are projected out, for example a straight line of a torque against speed (viscous friction).",
    ),
    "waterfall": (
        "Bar chart of the gap after each effect is added.",
        "Gap (rms above the noise) after each added effect, the largest contribution first.",
    ),
    "gap_horizon": (
        "Line chart of the gap of the bare and of the corrected model against the segment length.",
        "Gap (rms above the noise) against the length of segments with free initial states.",
    ),
}

_MAPS = (
    "Torque or reading error that the bare model would need at each location, before any effect is named."
    " The maps only indicate where a cause may act: a sensor error can resemble a torque, and one cause can appear in"
    " several maps. The result of the diagnosis is the list of named effects."
)
_MODELS = "The exported models omit amplitudes that are not distinguishable from zero, which changes other sizes."
_FAULTS = (
    "Faults of the readings that were detected before the fit. Outliers and repeated samples were excluded from all"
    " fits. diagnosis.json lists every fault."
)


def write_gap_report(
    diagnosis: Diagnosis,
    title: str,
    out_dir: Path,
    figures: Mapping[str, Path],
    acceptance: Acceptance | None = None,
) -> Path:
    """Write `diagnosis.html`.

    Args:
        diagnosis: the result
        title: heading of the page
        out_dir: folder of the page
        figures: figures by name, from `save_gap_figures`
        acceptance: results of limits, which are shown first; None if no limits were tested

    Raises:
        DprError: the page cannot be written.
    """
    drawn = pictures(figures, FIGURES | {s.name: (s.alternative, s.caption) for s in SECTIONS})
    evidence = {
        section.name: Section(section.title, evidence_blocks(section, diagnosis, drawn), f"section-{section.name}")
        for section in SECTIONS
        if diagnosis.evidence is not None
    }
    closure = evidence.pop(CLOSING.name).blocks if evidence else [drawn["waterfall"]]
    curves = evidence.pop("curves", None)
    limits = [Section("Acceptance", list(_acceptance(acceptance)), "acceptance", is_open=True)] if acceptance else []
    lengths, detectable = tables.horizon_table(diagnosis), tables.detectable_table(diagnosis)
    sections = [
        *limits,
        Section("Recommended actions", list(_actions(diagnosis))),
        Section("Effects and alternatives", list(_effects(diagnosis))),
        *([curves] if curves else []),
        Section("Results of checks", list(_checks(diagnosis))),
        Section("Gap reduction", [*closure, *_gap_reduction(diagnosis), drawn["gap_horizon"], lengths]),
        Section("Residual maps", [*_maps(diagnosis), drawn.get("where")]),
        Section("Sensor faults", [_faults(diagnosis)]),
        *evidence.values(),
        Section("Minimum detectable effects", [replace(detectable, caption=_assumed_scale(diagnosis))]),
        Section("Model search", [trial_table(diagnosis)]),
        Section("Assumptions", [Items([in_words(text) for text in diagnosis.assumptions])]),
    ]
    page = page_html(title, in_words(diagnosis.sentence), sections, lead=list(_lead(diagnosis)))
    return write_page(page, out_dir / "diagnosis.html")


def _lead(diagnosis: Diagnosis) -> Iterator[Block]:
    """Yield the blocks below the verdict: gap budget, reproducible part, causes, notes."""
    if bar := budget_bar(diagnosis):
        yield bar
    if bar := repeatability_bar(diagnosis):
        yield bar
        yield " ".join(repeatability_sentences(diagnosis))
    yield tables.summary_table(diagnosis, brief=True)
    if note := summary_note(diagnosis):
        yield note
    if diagnosis.common:
        yield Heading("Fit of the common effects alone")
        yield tables.common_table(diagnosis)
    yield Items([in_words(text) for text in diagnosis.notes])


def _acceptance(acceptance: Acceptance) -> Iterator[Block]:
    """Yield the test result of each limit, and the releases proposed for undecided limits."""
    yield f"{answer_sentence(acceptance)}."
    yield replace(limit_table(acceptance), caption=f"{RULE} {limit_note(acceptance)}".rstrip())
    if sentence := deciding_sentence(acceptance):
        yield sentence
        yield Items(acceptance.recordings, numbered=True)


def _actions(diagnosis: Diagnosis) -> Iterator[Block]:
    """Yield the remedies of the named effects, then checks and recordings for open questions."""
    if diagnosis.remedies:
        yield Items([in_words(text) for text in diagnosis.remedies])
        yield Heading("Next recordings and checks")
    yield Items(next_steps(diagnosis), numbered=True)
    if check_tables.informative(diagnosis.checks):
        checks = check_tables.check_table(diagnosis)
        yield replace(checks, caption=f"{checks.caption} {check_tables.how_to_record(diagnosis, 'diagnosis.json')}")


def _effects(diagnosis: Diagnosis) -> Iterator[Block]:
    if not diagnosis.effects:
        yield "No effect is named."
    effects = tables.effect_table(diagnosis)
    of_models = _MODELS if any(IN_MODELS in row[-1] for row in effects.rows) else ""
    yield replace(effects, caption=" ".join(filter(None, (effects.caption, of_models, scale_note(diagnosis)))))
    yield tables.standing_table(diagnosis)


def _checks(diagnosis: Diagnosis) -> Iterator[Block]:
    """Yield the probabilities before and after each check."""
    for done in diagnosis.checks_done:
        yield f"{done.check.id}: {in_words(done.check.text)} {done.result}"
        yield check_tables.moved_table(done)


def _gap_reduction(diagnosis: Diagnosis) -> Iterator[Block]:
    closed = tables.closed_table(diagnosis)
    if diagnosis.evidence is not None:  # the budget contains the errors of the free runs
        closed = PageTable(closed.columns[:2], [row[:2] for row in closed.rows], style="prose")
    if diagnosis.gap.waterfall or diagnosis.evidence is None:
        yield closed
    if diagnosis.gap.waterfall:
        yield tables.step_table(diagnosis)


def _maps(diagnosis: Diagnosis) -> Iterator[Block]:
    yield _MAPS if diagnosis.where else in_words(diagnosis.where_sentence)
    yield tables.place_table(diagnosis)
    yield tables.map_table(diagnosis)


def _assumed_scale(diagnosis: Diagnosis) -> str:
    """State the scale of the sizes; empty if the scale is known, or for an older version."""
    return f"Absolute sizes: {words}." if (words := assumed(diagnosis)) else ""


def _faults(diagnosis: Diagnosis) -> Block:
    faults = finding_table(diagnosis)
    return replace(faults, caption=_FAULTS) if faults else "No sensor fault was found."
