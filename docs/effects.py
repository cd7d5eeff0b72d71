"""Write docs/effects.md from the library itself: `python docs/effects.py`."""

from pathlib import Path

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.families import FAMILIES, Family
from dpr_lab.effects.limits import limit_words

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# The effect library

What `dpr-lab diagnose` can name. Each effect is one file in `dpr_lab/effects`; a parameter of zero switches it off.
Twins look alike in a free swing; the bench check tells them apart. Numbers of equations are those
of [theory.md](theory.md). This page is written by `docs/effects.py`.

No fit gives an amplitude beyond its limit, which follows from the best known values of the rig file: gravity torques,
inertias, lengths, counts per turn. A third of the limit is the standard deviation of a normal prior about zero. An
amplitude that recordings cannot distinguish from the ratios, the zeros or the initial states is not fitted; the
diagnosis lists it in `absorbed`. An effect with an amplitude at its limit has another cause and is not named.
"""


def page() -> str:
    """The whole page, as Markdown."""
    families = ["## Effects of one component\n", *map(together, FAMILIES)]
    return "\n".join([HEAD, *map(section, EFFECTS.values()), *families, ""])


def section(effect: Effect) -> str:
    """One effect: equation, parameters, twins, bench check, source."""
    equation = effect.equation.replace("`", "")  # it stands in code marks itself
    lines = [
        f"## {effect.words[0].upper()}{effect.words[1:]}: `{effect.name}`",
        "",
        f"Site: {effect.site}. {'Only takes energy out. ' if effect.dissipative else ''}`{equation}`",
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
    """What several effects together are."""
    marks, rest = (", ".join(f"`{name}`" for name in names) for names in (family.marks, family.parts))
    words = f"{family.words[0].upper()}{family.words[1:]}"
    return f"- {words}, `{family.name}`: two or more of {rest}, one at least of {marks}."


def row(parameter: EffectParameter) -> str:
    """One parameter of the table."""
    limit = limit_words(parameter) if parameter.role == "amplitude" else ""
    cells = (f"`{parameter.name}`", parameter.unit, f"{parameter.typical:g}", limit, parameter.sign, parameter.role)
    return f"| {' | '.join(cells)} |"


def related(effect: Effect) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """What else looks like it, and what hides it."""
    return ("Twins", effect.twins), ("Simpler forms", effect.nested), ("Taken up exactly by", effect.absorbed_by)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
