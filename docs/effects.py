"""Write docs/effects.md from the library itself: `python docs/effects.py`."""

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.families import FAMILIES, Family
from dpr_lab.effects.limits import limit_words

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# The effect library

This page explains the effects that `dpr-lab diagnose` can name: symptom, equation, parameters, and a bench check that
confirms the effect. `dpr-lab effects show NAME` prints one effect with units, typical sizes and source.

- *Notation.* i is the number of the joint: 0 (arm), 1 or 2. The other symbols are those of [Theory](theory.md).
- *Indistinguishable from* lists effects that a free swing can hardly distinguish. The bench check separates them.
- *Absent effects.* An effect is absent if its amplitudes are zero. A shape parameter has no meaning without an
  amplitude.
- *Limits.* No fitted amplitude exceeds its range. The range follows from gravity torques, inertias, lengths and
  counts per turn of the rig file. An effect with an amplitude at its limit is not named, because the true cause is
  a different effect.
- *Priors.* The prior of an amplitude is normal. Its mean is zero, and its standard deviation is a third of the limit.
  Each common effect has ten times the prior odds of another effect ([how the diagnosis
  decides](how-the-diagnosis-decides.md)).
- *Absorbed amplitudes.* An amplitude that is indistinguishable from the ratios, the zeros or the initial states is not
  fitted. The diagnosis lists it in `absorbed`.

"""

SOURCES = """## Sources of the equations

| source | effects |
|---|---|
"""


def page() -> str:
    """Return the whole page, as Markdown."""
    families = ["## Effects of one component\n", *map(together, FAMILIES)]
    sources: dict[str, dict[str, None]] = {}
    for effect in EFFECTS.values():
        sources.setdefault(effect.source, {})[re.sub(r"(joint|link)\d$", r"\1<i>", effect.name)] = None
    cited = [f"| {source} | {', '.join(f'`{name}`' for name in names)} |" for source, names in sources.items()]
    return "\n".join([HEAD + "\n".join(sections()), *families, "", SOURCES + "\n".join(cited), ""])


def sections() -> Iterator[str]:
    """Text of each effect, or one text of both effects if they differ only in the number of the joint."""
    merged = set()
    for name, effect in EFFECTS.items():
        other = EFFECTS.get(f"{name[:-1]}2", effect)
        text = both_joints(section(effect), section(other))
        if other is not effect and text:
            merged.add(other.name)
            text = text.replace(f"`{name[:-1]}i`", f"`{name}`, `{other.name}`", 1)
            yield re.sub(r"(joint|link)i`", r"\1<i>`", text)
        elif name not in merged:
            yield section(effect, short=True)


def both_joints(first: str, second: str) -> str:
    """Return the common text with i as the number of the joint; empty if the texts differ in anything else."""
    pairs = list(zip(first, second, strict=False))
    if len(first) != len(second) or {pair for pair in pairs if pair[0] != pair[1]} != {("1", "2")}:
        return ""
    return "".join(one if one == two else "i" for one, two in pairs)


def section(effect: Effect, *, short: bool = False) -> str:
    """One effect: symptom, site, equation, indistinguishable effects, bench check, parameters.

    If `short` is true, equation and parameters are omitted if they are those of joint 1.
    """
    properties = ("dissipative", effect.dissipative), ("common", effect.common)
    lines = [
        f"## {effect.words[0].upper()}{effect.words[1:]}: `{effect.name}`",
        "",
        effect.symptom,
        "",
        f"- Site: {', '.join([effect.site, *(word for word, applies in properties if applies)])}",
    ]
    equation, parameters = equation_of(effect), list(rows(effect))
    other = EFFECTS.get(f"{effect.name[:-1]}1")
    if short and other and other is not effect and (equation, parameters) == (equation_of(other), list(rows(other))):
        lines.append("- Equation and parameters: as for joint 1")
        parameters = []
    else:
        lines.append(f"- Equation: `{effect.equation.replace('`', '')}`")  # it stands in code marks itself
    lines += [
        *(f"- {what}: {', '.join(f'`{name}`' for name in names)}" for what, names in related(effect) if names),
        f"- Bench check: {effect.bench_check}",
        *(["", "| parameter | range |", "|---|---|", *parameters] if parameters else []),
        "",
    ]
    return "\n".join(lines)


def equation_of(effect: Effect) -> str:
    """Equation with `i` as the number of the joint, to compare the equations of several joints."""
    same = effect.equation.replace("the angle of the arm", "the angle of joint 0").replace("on the arm", "at joint 0")
    return re.sub(r"(?<=joint )[012]|(?<=encoder )[012]|(?<=q)[012]", "i", same)


def together(family: Family) -> str:
    """One component that causes several effects."""
    marks, rest = (", ".join(f"`{name}`" for name in names) for names in (family.marks, family.parts))
    words = f"{family.words[0].upper()}{family.words[1:]}"
    return f"- {words}, `{family.name}`: two or more of {rest}, including at least one of {marks}."


def rows(effect: Effect) -> Iterator[str]:
    """Rows of the table of parameters; successive parameters of the same range share a row."""
    for values, group in groupby(effect.parameters, range_of):
        names = [f"`{parameter.name}`" for parameter in group]
        yield f"| {', '.join(names)} | {values} |"


def range_of(parameter: EffectParameter) -> str:
    """Range of the values of a parameter, in words."""
    if parameter.role == "shape":
        return "shape parameter, positive"
    limit = limit_words(parameter)
    return f"0 to {limit}" if parameter.sign == "positive" else f"± {limit}"


def related(effect: Effect) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Effects with the same signature, simpler forms, and parameters that absorb it."""
    return (
        ("Indistinguishable from", effect.twins),
        ("Simpler forms", effect.nested),
        ("Absorbed by the parameter", effect.absorbed_by),
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
