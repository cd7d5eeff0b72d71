"""Write docs/rig-file.md from the model of a rig file: `python docs/rig_file.py`."""

import ast
from collections.abc import Iterator
from inspect import cleandoc, getsource
from itertools import pairwise
from pathlib import Path
from textwrap import dedent
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from dpr_lab.report.tables import PARAMETER_UNITS
from dpr_lab.rig import Rig

PAGE = Path(__file__).with_name("rig-file.md")

HEAD = """# The rig file

A rig file is a TOML file with the measured values of a rig, the bounds of the parameters to identify, and the
properties of the encoders. This page explains every key.

| command | source of the values |
|---|---|
| `dpr-lab rig new` | questions on the terminal, or options |
| `dpr-lab rig from` | a simulator model |
| `dpr-lab rig show` | a built-in rig |

`dpr-lab rig check` rejects a key that is unknown, missing or outside its range, and states its position in the file.
It also rejects a mass above 100 kg per metre of its rod, which is probably in grams.

```sh
dpr-lab rig new --name bench --l1 0.3 --l2 0.25 --m1 0.21+-0.001 --m2 0.12+-0.001 --out my_rig.toml
dpr-lab rig from robot.xml --joints shoulder,elbow --out from_model.toml
dpr-lab rig show paper > paper.toml
dpr-lab rig check my_rig.toml
```

All values are in SI units. All angles are absolute: 0 = upright, pi = hanging. Numbers must not be written in quotation
marks. In the column "range", x is a number and n an integer.

## Correct a rig file after the recordings

Each run stores the rig file of its recording. If you find a wrong length, mass or gravity later, correct the rig file
and pass it with `--rig`. The recordings need not be repeated. A note lists the keys that differ from the run.

- *Properties of a recording.* Mounted rods, added mass, `zero_counts` and the modes of arm and inner rod are taken from
  the run. To correct them, write a copy: `dpr-lab run recover old.mcap --rig corrected.toml --out new.mcap`. Import a
  table again if its modes or the zeros of angles without counts are wrong.
- *Single rod.* `L1` does not influence the swing of a single rod. If its length is wrong, correct `l1` and `J1` with
  their bounds, or write a new file with `rig new`.
- *Another machine.* A run of a rig with another name, `counts_per_rev`, `direction` or `joint2` is refused.
"""

TAILS = {
    "parameters": "A free swing determines five ratios. `dpr-lab identifiability --rig my_rig.toml` lists the bench"
    " measurements that would determine further parameters.",
    "poses": "Without poses, tables can be imported, but `capture` cannot release the rods.",
    "rods": "The options `--rods` and `--elbow` of `capture` and `import` set these keys for one run. `identify` and"
    " `diagnose` accept runs with different mountings of one rig together. The rig file of a rig with only one rod"
    ' contains `mounted = "inner"`. It needs only the parameters `l1`, `m1`, `c1` and `J1`; its poses and tables need'
    " no `theta2`.",
    "added_mass": "Recordings with and without the mass together determine the scale of all masses. Their rig files"
    " differ only by this table.",
}

KINDS = {float: "x", int: "n"}
WIDEST = {2**31: "2^31", -(2**31): "-2^31", 2**31 - 1: "2^31 - 1"}


def page() -> str:
    """Return the whole page, as Markdown."""
    return "\n".join([HEAD, *(section(name, field) for name, field in Rig.model_fields.items())])


def section(name: str, field: FieldInfo) -> str:
    """One table of the file: what it is, its keys."""
    model = next(models_in(field.annotation))
    many = get_origin(field.annotation) is dict
    title = f"[{name}.NAME]" if many else f"[{name}]"
    how = "required to record" if name == "poses" else "nine tables, all required for two rods" if many else ""
    how = how or ("required" if field.is_required() else "optional")
    lines = [f"## `{title}`, {how}", "", as_prose(model.__doc__), ""]
    if name == "parameters":
        lines += [
            *(
                f"- `{key}`: {meaning.replace('CoM', 'centre of mass')}, {unit}"
                for key, (unit, meaning) in PARAMETER_UNITS.items()
            ),
            "",
        ]
    lines += ["| key | default | range | meaning |", "|---|---|---|---|"]
    meanings = docstrings(model)
    lines += [row(key, inner, meanings[key]) for key, inner in model.model_fields.items()]
    return "\n".join([*lines, *([f"\n{TAILS[name]}"] if name in TAILS else []), ""])


def as_prose(text: str | None) -> str:
    """Return a docstring as Markdown, its formulas as code; what it says of Python is left out."""
    kept = cleandoc(text or "").split("\n\nArgs")[0]
    return kept


def docstrings(model: type[BaseModel]) -> dict[str, str]:
    """Return what the source says below each key of a table."""
    (table,) = ast.parse(dedent(getsource(model))).body
    assert isinstance(table, ast.ClassDef)
    return {
        key.target.id: result.value.value
        for key, result in pairwise(table.body)
        if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name)
        if isinstance(result, ast.Expr)
        and isinstance(result.value, ast.Constant)
        and isinstance(result.value.value, str)
    }


def row(name: str, field: FieldInfo, meaning: str) -> str:
    """One key of a table."""
    default = "required" if field.is_required() else "none" if field.default is None else f"`{shown(field.default)}`"
    may_be = "; ".join(dict.fromkeys(ranges(field.annotation, field.metadata)))
    return f"| `{name}` | {default} | {may_be} | {' '.join(meaning.split())} |"


def shown(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(shown, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"


def ranges(kind: Any, metadata: list[Any]) -> Iterator[str]:
    """Return what a value may be, in words."""
    if get_origin(kind) is Annotated:
        inner, *result = get_args(kind)
        yield from ranges(inner, [part for one in result for part in getattr(one, "metadata", [one])])
    elif get_origin(kind) in (Union, UnionType):
        for other in get_args(kind):
            yield from ranges(other, metadata) if other is not NoneType else ()
    elif get_origin(kind) is tuple:
        parts = [other for other in get_args(kind) if other is not Ellipsis]
        inner = "; ".join(dict.fromkeys(text for other in parts for text in ranges(other, [])))
        yield f"{len(parts)} values, {inner}" if len(parts) == len(get_args(kind)) else f"list of {inner}"
    elif get_origin(kind) is Literal:
        yield " or ".join(f"`{shown(value)}`" for value in get_args(kind))
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        yield "table as `[parameters.NAME]`"
    elif kind is bool:
        yield "`true` or `false`"
    elif kind in (int, float):
        yield interval(KINDS[kind], metadata)
    else:
        yield "text"


def interval(symbol: str, metadata: list[Any]) -> str:
    """Return the range of a number as an inequality, for example `0 < x <= 10`."""
    signs = {"gt": "<", "ge": "<=", "lt": "<", "le": "<="}
    limits = {key: getattr(m, key) for m in metadata for key in signs if getattr(m, key, None) is not None}
    ends = {key: f"{WIDEST.get(value, format(value, 'g'))}" for key, value in limits.items()}
    lower = "".join(f"{ends[key]} {signs[key]} " for key in ("gt", "ge") if key in ends)
    upper = "".join(f" {signs[key]} {ends[key]}" for key in ("lt", "le") if key in ends)
    return f"{lower}{symbol}{upper}"


def models_in(kind: Any) -> Iterator[type[BaseModel]]:
    """Return the models inside an annotation."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
    for other in get_args(kind):
        yield from models_in(other)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
