"""The parts of a benchmark, of which --only chooses some."""

from argparse import Namespace
from collections.abc import Callable, Mapping
from typing import Any

from common import chosen, conclude

__all__ = ["run_parts"]


def run_parts(
    options: Namespace, parts: Mapping[str, Callable[[Namespace], dict[str, Any]]]
) -> None:
    """Run them one after the other, and write their entries as one summary."""
    summary: dict[str, Any] = {}
    for name in chosen(options, parts):
        summary |= parts[name](options)
    conclude(options.out, summary)
