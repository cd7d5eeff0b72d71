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

A rig file describes the measured values of a rig, the bounds of the parameters to identify, and the encoders. It is
TOML. A key that is unknown, missing or outside its range is rejected with its position. To write a rig file, answer
questions (`dpr-lab rig new` alone, on a terminal), give options, or start from a built-in rig. Then check the file:

```sh
dpr-lab rig new --name bench --l1 0.3 --l2 0.25 --m1 0.21+-0.001 --m2 0.12+-0.001 --out my_rig.toml
dpr-lab rig from robot.xml --joints shoulder,elbow --out from_model.toml
dpr-lab rig show paper > paper.toml
dpr-lab rig check my_rig.toml
```

All values are in SI units, all angles are absolute: 0 = upright, pi = hanging. Numbers are written as numbers, not as
text. This page is written by `docs/rig_file.py` from the model that reads the file.
"""

TAILS = {
    "parameters": "A free swing determines five ratios. `dpr-lab identifiability --rig my_rig.toml` lists the bench"
    " measurements that determine more.",
    "poses": "Without poses, tables can be imported, but `capture` cannot release the rods.",
    "rods": "`dpr-lab capture` and `dpr-lab import` also accept it as `--rods` and `--elbow` and store it in the run."
    " One `identify` or `diagnose` accepts runs of one rig with both rods, with one rod and with a clamped elbow,"
    ' with the same rig file. A rig with one rod only has `mounted = "inner"` in its rig file. It needs only the'
    " parameters `l1`, `m1`, `c1` and `J1`; its poses and tables need no `theta2`.",
    "added_mass": "Recordings with and without the mass together determine the scale of all masses. Recordings with it"
    " need a rig file that differs only by this table.",
}


def page() -> str:
    """The whole page, as Markdown."""
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
    """A docstring as Markdown, its formulas as code; what it says of Python is left out."""
    kept = cleandoc(text or "").split("\n\nArgs")[0]
    return kept


def docstrings(model: type[BaseModel]) -> dict[str, str]:
    """What the source says below each key of a table."""
    (table,) = ast.parse(dedent(getsource(model))).body
    assert isinstance(table, ast.ClassDef)
    return {
        key.target.id: said.value.value
        for key, said in pairwise(table.body)
        if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name)
        if isinstance(said, ast.Expr) and isinstance(said.value, ast.Constant) and isinstance(said.value.value, str)
    }


def row(name: str, field: FieldInfo, meaning: str) -> str:
    """One key of a table."""
    default = "required" if field.is_required() else "none" if field.default is None else f"`{shown(field.default)}`"
    may_be = "; ".join(dict.fromkeys(ranges(field.annotation, field.metadata)))
    return f"| `{name}` | {default} | {may_be} | {' '.join(meaning.split())} |"


def shown(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(shown, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"


def ranges(kind: Any, metadata: list[Any]) -> Iterator[str]:
    """What a value may be, in words."""
    if get_origin(kind) is Annotated:
        inner, *said = get_args(kind)
        yield from ranges(inner, [part for one in said for part in getattr(one, "metadata", [one])])
    elif get_origin(kind) in (Union, UnionType):
        for other in get_args(kind):
            yield from ranges(other, metadata) if other is not NoneType else ()
    elif get_origin(kind) is tuple:
        parts = [other for other in get_args(kind) if other is not Ellipsis]
        inner = "; ".join(dict.fromkeys(text for other in parts for text in ranges(other, [])))
        yield f"{len(parts)} times {inner}" if len(parts) == len(get_args(kind)) else f"list of {inner}"
    elif get_origin(kind) is Literal:
        yield " or ".join(f"`{shown(value)}`" for value in get_args(kind))
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        yield f"table of {', '.join(f'`{key}`' for key in kind.model_fields)}"
    elif kind is bool:
        yield "`true` or `false`"
    elif kind in (int, float):
        words = {"gt": "above", "ge": "from", "lt": "below", "le": "to"}
        said = [f"{words[k]} {getattr(m, k):g}" for m in metadata for k in words if getattr(m, k, None) is not None]
        yield f"{'whole number' if kind is int else 'number'} {' '.join(said)}".strip()
    else:
        yield "text"


def models_in(kind: Any) -> Iterator[type[BaseModel]]:
    """The models inside an annotation."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
    for other in get_args(kind):
        yield from models_in(other)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
