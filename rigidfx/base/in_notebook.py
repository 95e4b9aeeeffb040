"""Values as a notebook shows them: tables of HTML."""

from collections.abc import Mapping
from html import escape

from rigidfx.base.types import Array


def as_table(title: str, rows: Mapping[str, str]) -> str:
    """A table of names and values in words, with its heading, as HTML."""
    lines = [f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in rows.items()]
    return f"<table><caption>{escape(title)}</caption>{''.join(lines)}</table>"


def as_text(text: str) -> str:
    """Text whose columns stand below each other, as HTML."""
    return f"<pre>{escape(text)}</pre>"


def in_short(values: Array) -> str:
    """Some numbers with four digits."""
    return ", ".join(f"{value:.4g}" for value in values)
