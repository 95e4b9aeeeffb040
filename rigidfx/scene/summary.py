"""A scene in words: its effects, and which of them act when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from math import inf, isfinite
from typing import Any

import numpy as np

from rigidfx.effects import Effect, Table, Windowed

__all__ = ["effects_table", "in_words", "phases"]

ELSEWHERE = ("where", "components", "since", "until")  # not among the values


def in_words(record: Any) -> str:
    """Kind and values of a frozen record, such as a material."""
    return f"{_kind(record)}: {_values(record)}"


def effects_table(effects: Sequence[Effect]) -> list[str]:
    """A line for each effect: its kind, where it acts, its values, and when."""
    rows = [(_kind(e), _where(e), _values(e), _window(e)) for e in effects]
    width = [max(map(len, column)) for column in zip(*rows, strict=True)] if rows else []
    return [
        "  ".join(text.ljust(n) for text, n in zip(row, width, strict=True)).rstrip()
        for row in rows
    ]


def phases(effects: Sequence[Effect]) -> list[str]:
    """A line for each span of time in which the same effects act, from t = 0 on.

    Springs have no time window: they act in all of them. None if nothing of the kind is there.
    """
    windowed = [e for e in effects if isinstance(e, Windowed)]
    if not windowed and not any(e.is_lasting for e in effects):
        return []
    ends = {t for e in windowed for t in (e.since, e.until) if isfinite(t) and t > 0}
    lines = []
    starts = [0.0, *sorted(ends)]
    for begin, end in zip(starts, [*starts[1:], inf], strict=True):
        acting = [
            _short(e)
            for e in effects
            if e.is_lasting or (isinstance(e, Windowed) and e.acts(begin))
        ]
        span = f"from {begin:g} s on" if end == inf else f"{begin:g} … {end:g} s"
        lines.append(f"{span}: {', '.join(acting) or 'nothing'}")
    return lines


def _kind(effect: Any) -> str:
    return type(effect).__name__


def _short(effect: Effect) -> str:
    where = getattr(effect, "where", None)
    return _kind(effect) + (f" '{where}'" if where else "")


def _where(effect: Effect) -> str:
    if not hasattr(effect, "where"):
        return "everywhere"
    components = getattr(effect, "components", "xyz")
    axes = "" if components == "xyz" else f" ({components})"
    return "everywhere" if effect.where is None else f"on '{effect.where}'{axes}"


def _values(effect: Any) -> str:
    given = ((f, getattr(effect, f.name)) for f in fields(effect) if f.name not in ELSEWHERE)
    return ", ".join(
        f"{f.name} {_word(value)}" for f, value in given if not _idle(value, f.default)
    )


def _idle(value: Any, default: Any) -> bool:
    """Whether a value is its default and changes nothing: None, zeros, or the factor 1."""
    if value is None or default is None:
        return value is default
    same = np.shape(value) == np.shape(default) and np.all(value == default)
    return bool(same) and (not np.any(value) or (np.ndim(value) == 0 and value == 1))


def _word(value: Any) -> str:
    if isinstance(value, Table):
        return f"Table({value.times[0]:g} … {value.times[-1]:g} s)"
    if callable(value):
        return "function"
    if isinstance(value, Sequence) and value and isinstance(value[0], Effect):
        return "(" + ", ".join(map(_short, value)) + ")"
    if isinstance(value, float):
        return f"{value:g}"
    array = np.asarray(value)
    if array.ndim and array.dtype.kind in "fiu":
        return "(" + ", ".join(map(_word, array.tolist())) + ")"
    return str(value)


def _window(effect: Effect) -> str:
    if not isinstance(effect, Windowed):
        return ""
    if effect.since <= 0 and effect.until == inf:
        return "always"
    since = f"from {effect.since:g} s" if effect.since > 0 else ""
    until = f"until {effect.until:g} s" if effect.until < inf else ""
    return f"{since} {until}".strip()
