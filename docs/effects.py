"""Write docs/effects.md from the library itself: `python docs/effects.py`."""

from pathlib import Path

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.families import FAMILIES, Family
from dpr_lab.effects.limits import limit_words

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# The effect library

This page lists the effects that `dpr-lab diagnose` can name, each with its symptom at the rig and a bench check that
confirms it. Effects that a free swing can hardly distinguish are listed as "indistinguishable from"; the bench check
separates them. Each effect is defined in one file in `dpr_lab/effects`. An effect is off if its amplitude is zero.
Numbers of equations refer to [theory.md](theory.md). `dpr-lab effects show NAME` prints one effect. This page is
written by
`docs/effects.py`.

Each amplitude has a limit, which no fit exceeds. The limit follows from the measured or nominal values of the rig file:
gravity torques, inertias, lengths, counts per turn. The prior of an amplitude is normal, with mean zero and a third of
the limit as standard deviation. An amplitude that recordings cannot distinguish from the ratios, the zeros or the
initial states is not fitted; the diagnosis lists it in `absorbed`. An effect with an amplitude at its limit is not
named, because the true cause is a different effect.

| site | effects |
|---|---|
"""


def page() -> str:
    """The whole page, as Markdown."""
    families = ["## Effects of one component\n", *map(together, FAMILIES)]
    sites: dict[str, list[str]] = {}
    for effect in EFFECTS.values():
        sites.setdefault(effect.site, []).append(f"`{effect.name}`")
    overview = [f"| {site} | {', '.join(names)} |" for site, names in sites.items()]
    return "\n".join([HEAD + "\n".join(overview), "", *map(section, EFFECTS.values()), *families, ""])


def section(effect: Effect) -> str:
    """One effect: symptom, equation, parameters, indistinguishable effects, bench check, source."""
    equation = effect.equation.replace("`", "")  # it stands in code marks itself
    lines = [
        f"## {effect.words[0].upper()}{effect.words[1:]}: `{effect.name}`",
        "",
        effect.symptom,
        "",
        f"Site: {effect.site}{', dissipative' if effect.dissipative else ''}. Equation: `{equation}`",
        "",
        "| parameter | unit | typical | limit | sign | role |",
        "|---|---|---|---|---|---|",
        *map(row, effect.parameters),
        "",
        *(f"- {what}: {', '.join(f'`{name}`' for name in names)}" for what, names in related(effect) if names),
        f"- Bench check: {effect.bench_check}",
        f"- Source: {effect.source}",
        "",
    ]
    return "\n".join(lines)


def together(family: Family) -> str:
    """One component that causes several effects."""
    marks, rest = (", ".join(f"`{name}`" for name in names) for names in (family.marks, family.parts))
    words = f"{family.words[0].upper()}{family.words[1:]}"
    return f"- {words}, `{family.name}`: two or more of {rest}, including at least one of {marks}."


def row(parameter: EffectParameter) -> str:
    """One parameter of the table."""
    limit = limit_words(parameter) if parameter.role == "amplitude" else ""
    cells = (f"`{parameter.name}`", parameter.unit, f"{parameter.typical:g}", limit, parameter.sign, parameter.role)
    return f"| {' | '.join(cells)} |"


def related(effect: Effect) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Effects with the same signature, simpler forms, and parameters that absorb it."""
    return (
        ("Indistinguishable from", effect.twins),
        ("Simpler forms", effect.nested),
        ("Absorbed by the parameter", effect.absorbed_by),
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
