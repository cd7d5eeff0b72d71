"""`help()` of public names: signatures of plain type names, and what each field of a dataclass is."""

import ast
import inspect
import textwrap
from dataclasses import is_dataclass
from functools import cache
from itertools import pairwise
from types import NoneType, UnionType
from typing import Annotated, Any, ForwardRef, Literal, Union, get_args, get_origin


class _Plain(str):
    """A text that a signature shows without quotes."""

    __slots__ = ()
    __repr__ = str.__str__


@cache
def explain(value: Any, name: str) -> Any:
    """The same function or class, with the help of a public name.

    Args:
        value: a function or a class
        name: under which it is public
    """
    if inspect.isfunction(value):
        value.__name__ = name
        _sign(value)
    elif hasattr(value, "model_rebuild"):
        value.model_rebuild()  # built when first used, a model has a signature only afterwards
        _sign(value)
    elif is_dataclass(value):
        _sign(value)
        _sign(value.__init__)
        _explain_fields(value)
    return value


def _sign(value: Any) -> None:
    value.__signature__ = readable(inspect.signature(value))


def _explain_fields(cls: Any) -> None:
    """`help` prints the texts of slots that are a dictionary."""
    cls.__slots__ = {**dict.fromkeys(cls.__slots__), **field_docs(cls)}


def readable(signature: inspect.Signature) -> inspect.Signature:
    """The same signature with types as one writes them, and without long default values."""
    parameters = [
        one.replace(annotation=_annotated(one.annotation), default=_short(one.default))
        for one in signature.parameters.values()
    ]
    return signature.replace(parameters=parameters, return_annotation=_annotated(signature.return_annotation))


def plain_type(annotation: Any) -> str:
    """A type in the words of the source, without modules and metadata: `Mapping[str, float] | None`."""
    origin, parts = get_origin(annotation), get_args(annotation)
    match annotation:
        case str():
            return annotation
        case ForwardRef():
            return annotation.__forward_arg__
        case list():
            return f"[{', '.join(map(plain_type, annotation))}]"
        case _ if annotation in (None, NoneType):
            return "None"
        case _ if annotation is ...:
            return "..."
    if origin is Annotated:
        return plain_type(parts[0])
    if origin in (Union, UnionType):
        return " | ".join(map(plain_type, parts))
    if origin is Literal:
        return f"Literal[{', '.join(map(repr, parts))}]"
    if parts:
        return f"{origin.__name__}[{', '.join(map(plain_type, parts))}]"
    return getattr(annotation, "__name__", str(annotation))


def field_docs(cls: type) -> dict[str, str]:
    """Text below each field of a dataclass, as its source has it; empty where there is no source."""
    try:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    except (OSError, SyntaxError):
        return {}
    body = tree.body if isinstance(tree, ast.ClassDef) else []
    return {
        field.target.id: inspect.cleandoc(below.value.value)
        for field, below in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
    }


def _annotated(annotation: Any) -> Any:
    return annotation if annotation is inspect.Signature.empty else _Plain(plain_type(annotation))


def _short(default: Any, longest: int = 30) -> Any:
    """A default value, or `...` if its text is longer than a signature can hold."""
    return default if default is inspect.Parameter.empty or len(repr(default)) <= longest else _Plain("...")
