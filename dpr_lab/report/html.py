"""Write the HTML report of an identification: one file with embedded figures."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.identify import ArmComparison
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.report import moving_arm, tables
from dpr_lab.report.figures import error_figure, response_figure, save_each
from dpr_lab.report.pages.page import Formula, Items, Section, page_html, pictures, write_page

FIGURES = {
    "response": (
        "Line charts of the angles of inner and outer rod over time, measured and simulated, for each run.",
        "Measured and simulated angle, 0 = upright, π = hanging. The free run is dashed up to the predictability"
        " horizon. Beyond it the uncertainty of the initial state dominates, so the faint line does not validate the"
        " model.",
    ),
    "error": (
        "Line charts of measured minus simulated angle over time with the noise floor, for each run.",
        "Left: measured minus free run, up to the horizon. Right: residuals of segments with free initial states."
        " Residuals inside the band and without a pattern are noise; a pattern shows an effect that the model lacks.",
    ),
    "evolution": (
        "Line charts of cost, fitness and population fitness against the generations of the search.",
        "Cost and fitness of the best individual, and fitness of the population, until the local solver starts.",
    ),
}
"""Text alternative and caption of each figure. The tables contain the values of the figures."""

FIGURES_OF_ARM = {
    "response": (
        "Line charts of the angles of arm and rods over time, measured and simulated, for each run.",
        "Angles as their encoders read them: theta0 of the arm, theta1 with 0 = upright. The initial state of each"
        " segment is fitted.",
    ),
    "error": (
        "Line charts of measured minus simulated angle over time with the noise floor, for each run.",
        "Residuals inside the band and without a pattern are noise; a pattern shows an effect that the model lacks.",
    ),
}

_RATIO_FORMULAS = (
    "a  = J1 + m1 l1² + (m2 + mb) L1²      b = J2 + m2 l2²",
    "e1 = (m1 l1 + (m2 + mb) L1) g         d = m2 L1 l2",
)
_SCALE = (
    "If the arm is clamped, no external torque acts on the rods. Every term of the equation of motion is"
    " proportional to a mass, an inertia or a friction coefficient. If all of these are multiplied by one factor,"
    " the motion does not change. The nine parameters enter only through a, b, d, e1, c1 and c2. A free swing"
    " determines these six numbers only up to a common factor, so it identifies five ratios. Four of the nine"
    " parameters must be weighed or measured."
)


def write_report(model: Model, comparisons: Sequence[Comparison], out_dir: Path, figures: Mapping[str, Path]) -> Path:
    """Write `report.html`: ratios, parameters, and comparison of measurement and simulation.

    Args:
        model: the identification
        comparisons: runs that are simulated with the model; may be empty
        out_dir: folder of the report, created if it does not exist
        figures: figures to embed, from `save_figures`

    Raises:
        DprError: the folder or a file cannot be written.
    """
    drawn = pictures(figures, FIGURES)
    base = tables.base_table(model)
    ratios = [
        "Free swings identify these five ratios. A simulation of a free swing needs only these ratios, L1"
        f" = {model.rig.L1:g} m and g = {model.rig.g:g} m/s².",
        tables.ratio_table(model),
        tables.ratio_note(model),
        "The scale is known. The base parameters are therefore also determined:" if base else None,
        base,
        Formula(_RATIO_FORMULAS),
    ]
    parameters = [
        _SCALE,
        replace(tables.parameter_table(model), caption=tables.parameter_note(model)),
    ]
    compared = [tables.comparison_table(comparisons), drawn["response"], drawn["error"]]
    sections = [
        Section("Identified ratios", ratios, is_open=True),
        Section("Physical parameters", parameters),
        Section("Measured and simulated angles", compared if comparisons else ["No run was compared."]),
        Section("Search", [tables.search_table(model), drawn["evolution"]]),
        Section("Fitted runs", [tables.run_table(model)]),
    ]
    return _write_page(model, "", tables.summary(model, comparisons), sections, out_dir)


def write_arm_report(
    model: MovingArmModel, runs: Sequence[ArmComparison], compared: Mapping[str, Any], out_dir: Path
) -> Path:
    """Write `report.html` with its figures, and return the path of the file.

    Args:
        model: the model
        runs: runs that are simulated with the model
        compared: errors of these runs, as JSON values
        out_dir: folder of the report

    Raises:
        DprError: the folder or a file cannot be written.
    """
    drawn = pictures(
        save_each({"response": response_figure(runs), "error": error_figure(runs)}, out_dir), FIGURES_OF_ARM
    )
    scale = f"{model.scale_sentence} A is the total inertia about the arm's axis."
    sections = [
        Section(
            "Measured and simulated angles",
            [moving_arm.comparison_table(compared), drawn["response"], drawn["error"]],
            is_open=True,
        ),
        Section(
            f"Ratios to {model.scale}",
            [
                tables.ratio_table(model),
                Items([f"{name}: {reason}" for name, reason in model.undetermined.items()]),
            ],
            is_open=True,
        ),
        Section("Absolute values", [replace(moving_arm.absolute_table(model), caption=scale)]),
        Section("Notes", [Items(model.notes)]),
    ]
    return _write_page(model, " with a moving arm", moving_arm.summary(model), sections, out_dir)


def _write_page(model: AnyModel, arm: str, summary: str, sections: Sequence[Section], out_dir: Path) -> Path:
    """Write `report.html` with the warnings of a model, then the given sections; return its path."""
    warnings = Section("Warnings", [Items([*model.failures, *model.warnings])], "warnings", is_open=True)
    footer = f"Rig {model.rig.name}, file SHA-256 {model.rig.sha256 or 'unknown'}. Written by dpr-lab {model.version}."
    title = f"Rig “{model.rig.name}”{arm}: identified model"
    return write_page(page_html(title, summary, [warnings, *sections], footer=footer), out_dir / "report.html")
