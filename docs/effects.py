"""Write docs/effects.md from the library itself: `python docs/effects.py`."""

from pathlib import Path

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect, EffectParameter

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# The effect library

What `dpr-lab diagnose` can name. Each effect is one file in `dpr_lab/effects`; a parameter of zero switches it off.
Twins look alike in a free swing; the bench check tells them apart. This page is written by `docs/effects.py`.
"""


def page() -> str:
    """The whole page, as Markdown."""
    return "\n".join([HEAD, *map(section, EFFECTS.values())])


def section(effect: Effect) -> str:
    """One effect: equation, parameters, twins, bench check, source."""
    lines = [
        f"## `{effect.name}`",
        "",
        f"Site: {effect.site}. {'Only takes energy out. ' if effect.dissipative else ''}`{effect.equation}`",
        "",
        "| parameter | unit | typical | sign | role |",
        "|---|---|---|---|---|",
        *map(row, effect.parameters),
        "",
        *(f"- {what}: {', '.join(f'`{name}`' for name in names)}" for what, names in related(effect) if names),
        f"- Bench check: {effect.bench_check}",
        f"- Source: {effect.source}",
        "",
    ]
    return "\n".join(lines)


def row(parameter: EffectParameter) -> str:
    """One parameter of the table."""
    return f"| `{parameter.name}` | {parameter.unit} | {parameter.typical:g} | {parameter.sign} | {parameter.role} |"


def related(effect: Effect) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """What else looks like it, and what hides it."""
    return ("Twins", effect.twins), ("Simpler forms", effect.nested), ("Taken up exactly by", effect.absorbed_by)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
